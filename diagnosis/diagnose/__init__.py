"""From a recording to a verdict: what the simulation leaves out, by name."""
