"""Recordings of guidewires and their drives, each with a second motion of the same world.

A stage pushes a wire by a gripper through a sheath and a bent path against a wall, in a patient with heart
and breath; a load cell reads. Imports nothing of the product; records, asks and scores as the laboratory.
"""

from tests.hidden_effects.guidewire.draw import KINDS, TURN, draw

__all__ = ["KINDS", "TURN", "draw"]
