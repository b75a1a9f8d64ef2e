"""A guidewire pushed through planar vessels, by MuJoCo: recordings of an engine that is not ours.

Its friction is Coulomb's at every contact; that it grows along the path and builds up over a distance comes
of the bent wire in the clearance alone. Imports nothing of the product, and of the laboratory what a
recording, a motion and a score are.
"""

from tests.hidden_effects.vessels.draw import KINDS, draw

__all__ = ["KINDS", "draw"]
