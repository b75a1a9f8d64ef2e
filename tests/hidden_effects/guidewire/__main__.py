"""`python -m tests.hidden_effects.guidewire`."""

import sys

from tests.hidden_effects.guidewire import TURN, draw
from tests.hidden_effects.laboratory.command import main

if __name__ == "__main__":
    sys.exit(main("tests.hidden_effects.guidewire", TURN, draw, None))
