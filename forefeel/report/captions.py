"""What the captions of the figures say."""

from forefeel.report.svg import BINS

TRIM = 0.002
"""Share of the highest and of the lowest values of a trace that may lie outside of its picture."""

MOST_PARAMETERS = 12

_THINNED = f"Long traces are drawn as the smallest and largest value in each of {BINS} stretches of time."

FORCE = (
    "Above: predicted and held when a command was sent, and the force that was measured when the "
    "slave executed that command, drawn at the time of the command. Below: what the hand felt, which "
    "is the prediction scaled to the hand, limited, kept passive, and faded out while the slave does not "
    "follow. The band should hold 95 % of the measured forces. "
    f"{_THINNED}"
)
DETAIL = (
    "The same, from the middle of what was scored. The hold is a force of the past; the prediction "
    "should lie on the measured force."
)
ERROR = (
    f"Against the measured force, on the same commands. The highest and lowest {TRIM:.1%}, and a "
    "prediction that is far off, may lie outside of the picture; the figures in numbers count them. "
    f"{_THINNED}"
)
POSITION = f"Each drawn when it was sent; not by command, as the forces are. {_THINNED}"
STATES = (
    "From the slave's own messages, 50 a second. Silent: nothing was heard of it for longer than such "
    "a message counts."
)
DELAY = (
    "From a command to the arrival of the force that answers it, on the master's clock; once for each "
    "command that was answered."
)
PARAMETERS = (
    "With bands of two standard deviations, which know of noise and not of errors of the model. What "
    "is far off in the first quarter may lie outside of the picture. "
    f"At most {MOST_PARAMETERS} are drawn. {_THINNED}"
)
LATENESS = (
    "How late each tick began after its deadline; both axes are logarithmic. The first bin holds all "
    "that was earlier, the last all that was later."
)
