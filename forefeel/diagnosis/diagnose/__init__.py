"""From a recording to a verdict: what the simulation leaves out, by name."""

from forefeel.diagnosis.diagnose.diagnose import Diagnosed, diagnose

__all__ = ["Diagnosed", "diagnose"]
