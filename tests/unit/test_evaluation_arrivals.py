import numpy as np
import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.diagnosis.evaluation.arrivals import DelayedLink, arrivals
from tests.unit.evaluation_samples import made_up


def arrived_at(time_s: np.ndarray, link: DelayedLink) -> dict[int, int]:
    """The stamp (its index) at which each sample's force is new."""
    batches = arrivals(time_s, link).batches()
    assert len(batches) == len(time_s)
    return {i: k for k, batch in enumerate(batches) for i in batch}


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.1, 0.3, 0.301, 100 / 7])
@pytest.mark.parametrize("uneven", [0.0, 0.3])
def test_without_jitter_a_force_is_there_at_the_first_stamp_of_the_definition(
    delay_s: float, uneven: float
) -> None:
    time_s = made_up(duration_s=4.0, uneven=uneven).time_s
    found = arrived_at(time_s, DelayedLink(delay_s))
    for i, stamp in enumerate(time_s):
        there = np.flatnonzero(stamp <= time_s - delay_s)
        assert found.get(i) == (there[0] if len(there) else None)


def test_jitter_spreads_and_reorders_within_its_bounds() -> None:
    time_s = made_up(duration_s=30.0, gap_s=0.0).time_s
    link = DelayedLink(0.3, jitter_s=0.05, seed=4)
    batches = arrivals(time_s, link).batches()
    sequence = [i for batch in batches for i in batch]
    assert sequence != sorted(sequence)
    late_s = np.array([time_s[k] - time_s[i] for k, batch in enumerate(batches) for i in batch])
    assert late_s.min() >= 0.25
    assert late_s.max() <= 0.35 + 0.02  # up to the next stamp
    # uniform: its mean, and a third of the forces in the first third
    assert late_s.mean() == pytest.approx(0.305, abs=0.004)
    assert np.mean(late_s < 0.25 + 0.1 / 3 + 0.005) == pytest.approx(1 / 3, abs=0.04)


def test_no_force_is_there_before_its_own_stamp() -> None:
    time_s = made_up(duration_s=5.0).time_s
    found = arrived_at(time_s, DelayedLink(0.01, jitter_s=0.5))
    assert all(k >= i for i, k in found.items())
    assert sum(k == i for i, k in found.items()) > 100  # those that would be early


def test_loss_takes_its_share() -> None:
    time_s = np.arange(20_000) * 1e-3
    found = arrived_at(time_s, DelayedLink(0.0, loss=0.05, seed=1))
    assert 1 - len(found) / len(time_s) == pytest.approx(0.05, abs=0.006)


def test_the_seed_decides() -> None:
    time_s = made_up().time_s
    one, same, other = (arrivals(time_s, DelayedLink(0.3, 0.05, 0.1, seed)).order for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"delay_s": -0.1}, "--delay -0.1"),
        ({"delay_s": float("nan")}, "--delay nan"),
        ({"delay_s": 31.0}, "0 to 30 s"),
        ({"delay_s": 0.3, "jitter_s": float("inf")}, "--jitter inf"),
        ({"delay_s": 0.3, "loss": 1.0}, "--loss 1"),
        ({"delay_s": 0.3, "loss": float("nan")}, "--loss nan"),
        ({"delay_s": 0.3, "seed": -1}, "--seed -1"),
    ],
)
def test_a_link_that_can_not_be_is_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        DelayedLink(**wrong)  # type: ignore[arg-type]
