"""`python -m tests.hidden_effects.vessels`."""

import sys

from tests.hidden_effects.laboratory.command import main
from tests.hidden_effects.vessels import KINDS, draw

if __name__ == "__main__":
    sys.exit(main("tests.hidden_effects.vessels", tuple(KINDS), draw, None))
