"""Recordings that hide an effect, by a simulation of its own: nothing of the product is imported here."""

from tests.hidden_effects.generator.draw import OUTSIDE_NAMES, VOCABULARY, draw, drawn_pairs
from tests.hidden_effects.generator.truth import Hidden, Noise, Truth

__all__ = ["OUTSIDE_NAMES", "VOCABULARY", "Hidden", "Noise", "Truth", "draw", "drawn_pairs"]
