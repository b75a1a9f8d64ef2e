"""Whether a host and its settings are fit to run: green, amber, red, and what to do."""
