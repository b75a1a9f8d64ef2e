"""`python -m tests.hidden_effects.laboratory`."""

import sys

from tests.hidden_effects.laboratory import KINDS, draw
from tests.hidden_effects.laboratory.command import main

if __name__ == "__main__":
    sys.exit(main("tests.hidden_effects.laboratory", KINDS, draw, None))
