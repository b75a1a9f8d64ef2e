"""Recordings as strangers' laboratories make them, each with a second motion of the same world.

Designed from public recordings: a joint under gravity, a tensile test, ramps with holds, creep, a chirped
stage, strokes through a seal, palpation. Imports nothing of the product, nor of the other two generators;
only `ask` asks the diagnosis.
"""

from tests.hidden_effects.laboratory.draw import KINDS, draw
from tests.hidden_effects.laboratory.truth import Recorded, Truth

__all__ = ["KINDS", "Recorded", "Truth", "draw"]
