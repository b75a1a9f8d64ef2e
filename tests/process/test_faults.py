"""Faults of a running service on two hosts. The whole matrix is `make faults`, about half an hour."""

from functools import partial
from pathlib import Path

import pytest

from tests.system.faults import cases, required
from tests.system.faults.scene import Fault, Row, judge, staged, tried
from tests.system.net.hosts import needs_root

pytestmark = needs_root
FAULTS = {fault.name: fault for fault in cases.faults()}


@pytest.mark.soak
def test_a_stall_with_its_burst_and_a_frozen_master_stop_the_stage_and_nothing_old_moves_it(
    tmp_path: Path,
) -> None:
    chosen = [FAULTS["stall 0.3 s, burst"], FAULTS["master SIGSTOP 0.3 s"]]
    with staged(tmp_path, chosen[0]) as scene:
        incidents = [fault.act(scene) for fault in chosen]
        scene.service.close()
    for fault, incident in zip(chosen, incidents, strict=True):
        row = Row(fault.name, fault.recovery, fault.rest_s)
        judge(row, fault, incident, tmp_path)
        assert row.failures == []
        assert row.speed_m_s > 0.01, "it moved when the fault came"
        assert row.rest_s is not None and row.rest_s > required.NEAR.there_s


@pytest.mark.soak
@pytest.mark.timeout(180)
@pytest.mark.parametrize("name", ["round trip 20 -> 500 -> 20 ms", "two masters at once"])
def test_a_row_of_the_matrix_holds(name: str, tmp_path: Path) -> None:
    assert tried(FAULTS[name], tmp_path).failures == []


@pytest.mark.soak
@pytest.mark.timeout(180)
def test_a_slave_without_watchdog_and_age_limit_is_found_out(tmp_path: Path) -> None:
    """The measure itself: what the gate refuses is seen where the gate is open."""
    lax = {"slave": {"gate": {"watchdog_s": 0.3, "max_age_s": 1.0}}}
    act = partial(cases.stalled, 0.28)
    row = tried(Fault("lax", act, "", rest_s=required.BY_SILENCE_S, service={"axis": lax}), tmp_path)
    assert any("stale commands executed" in failure for failure in row.failures)
    assert any("at rest after" in failure for failure in row.failures)
