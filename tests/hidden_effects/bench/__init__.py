"""Recordings as a laboratory bench makes them, with what is hidden in them.

A second generator, designed from the bench and not from the diagnosis: bodies with inertia on a driven chain,
advanced in time, then sampled by an encoder and a load cell. It imports nothing of the product and nothing of
the first generator; only `score`, which asks the diagnosis, does (and `__main__` by it).
"""

from tests.hidden_effects.bench.effects import FAMILIES, canonical, family_of
from tests.hidden_effects.bench.made import LEAST_SHARE, Made, Population, draw, draw_two

__all__ = ["FAMILIES", "LEAST_SHARE", "Made", "Population", "canonical", "draw", "draw_two", "family_of"]
