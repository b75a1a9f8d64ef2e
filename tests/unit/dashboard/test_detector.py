"""The detector, in virtual time, on made-up errors."""

import numpy as np
import pytest

from forefeel.dashboard.detector import ModelWatch

GOOD = (0.005, 0.05)
"""Innovation in N and share of the forces outside of the band, as usual."""
Phase = tuple[int, int, float, float]


def watched(*phases: Phase) -> ModelWatch:
    """(from s, to s, innovation, share outside) one after the other."""
    watch = ModelWatch()
    for start, stop, innovation_n, outside in phases:
        rng = np.random.default_rng(start)
        for second in range(start, stop):
            spread = 1 + 0.15 * rng.normal()
            for tick in range(250):
                t_s = second + tick * 4e-3
                watch.force(t_s, bool(rng.random() < outside))
                if tick % 50 == 0:
                    watch.innovation(t_s, innovation_n * spread)
    return watch


WRONG = (20, 30, 0.02, 0.05)
RELAPSE = ((30, 33, *GOOD), (33, 34, 0.02, 0.05))


@pytest.mark.parametrize(
    "phases",
    [
        [(0, 300, *GOOD)],
        [(0, 20, *GOOD), (20, 21, 0.05, 0.9), (21, 25, *GOOD)],
        [(0, 3, *GOOD), (3, 6, 0.05, 0.9)],
        [(0, 20, *GOOD), WRONG, *RELAPSE, (34, 41, *GOOD)],
    ],
    ids=["nothing wrong", "one bad second", "usual not known", "good for a while"],
)
def test_model_watch_without_a_lasting_error_raises_no_alarm(phases: list[Phase]) -> None:
    assert watched(*phases).alarm is None


@pytest.mark.parametrize(
    ("phases", "ratio", "outside"),
    [
        ([(20, 23, 0.015, 0.05)], 3.0, 0.05),
        ([(20, 24, 0.005, 0.6)], 1.0, 0.6),
        ([WRONG, (30, 33, *GOOD)], 4.0, 0.05),
        ([WRONG, *RELAPSE, (34, 38, *GOOD)], 4.0, 0.05),
        ([(20, 200, 0.02, 0.05)], 4.0, 0.05),
    ],
    ids=["noticed in 3 s", "outside of the band", "good for 3 s", "good for 4 s", "wrong is not usual"],
)
def test_model_watch_alarm_says_since_when(phases: list[Phase], ratio: float, outside: float) -> None:
    alarm = watched((0, 20, *GOOD), *phases).alarm
    assert alarm is not None
    assert alarm.since_s == 20.0
    assert alarm.innovation_ratio == pytest.approx(ratio, rel=0.5)
    assert alarm.outside_share == pytest.approx(outside, abs=0.15)


def test_model_watch_of_a_hand_at_rest_raises_no_alarm() -> None:
    watch = watched((0, 20, *GOOD))
    for second in range(20, 40):
        watch.innovation(second + 0.5, 5.0)
    assert watch.alarm is None
