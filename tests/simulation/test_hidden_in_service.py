"""Hidden in the running service: an effect that the master does not know is named from the recording of the
run, and the extended model, loaded, makes the next run's live prediction better. Virtual time, the paper's
network.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.hidden_in_service import WALL, in_service, write_model
from forefeel.common.topics import FORCE
from forefeel.loopback.plan import LoopbackOptions, make_plan
from tests.looped import recorded


@pytest.mark.parametrize(
    ("effect", "most"),
    [
        # dry friction that turns at once is as uncertain as the instant of each reversal, which the network's
        # jitter moves by 4.5 ms
        ("coulomb_friction", 0.95),
        pytest.param("stiffening", 0.5, marks=pytest.mark.soak),
        pytest.param("hunt_crossley_damping", 0.5, marks=pytest.mark.soak),
        pytest.param("quadratic_drag", 0.6, marks=pytest.mark.soak),
    ],
)
def test_what_is_hidden_in_a_run_is_named_and_the_next_run_predicts_better(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, effect: str, most: float
) -> None:
    """The rms of the second run's error is at most that share of the first's."""
    monkeypatch.setattr("benchmarks.hidden_in_service.DURATION_S", 6.0)
    row = in_service(effect, tmp_path)
    assert {*row.named.split(", ")} - {"bias"} == {effect}  # the simulated load cell has an offset of 10 mN
    assert row.after_mn[0] < most * row.before_mn[0]


def test_an_effect_is_switched_on_during_the_run_and_changes_nothing_before(tmp_path: Path) -> None:
    """A bias of 0.2 N from 1 s of the world's time on: equal to the bit before, off by 0.2 N from then on."""
    world, hide = tmp_path / "world.yaml", tmp_path / "hidden.yaml"
    write_model(world, "mass_damper_spring", WALL)
    write_model(hide, "bias", {"force_n": 0.2})
    options = LoopbackOptions(slave_model=world, master_model=world, duration_s=1.5)
    plain, hidden = (
        recorded(make_plan(each), tmp_path / f"{each.hide_at_s}.mcap")
        for each in (options, replace(options, hide=hide, hide_at_s=1.0))
    )
    metadata = hidden.metadata["run"]
    assert (metadata["master_model"], metadata["hidden"]) == ("world.yaml", "hidden.yaml from 1 s on")
    plain_n, hidden_n = (run.column("insertion", FORCE, "force_n")[:1400] for run in (plain, hidden))
    differs_n = np.abs(hidden_n - plain_n)
    switched = np.flatnonzero(differs_n > 1e-9)[0]
    assert switched == pytest.approx(1000, abs=60)
    assert differs_n[switched + 5 : switched + 50] == pytest.approx(0.2, abs=0.02)
