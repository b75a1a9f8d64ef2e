"""The service between two hosts whose packets take up to 900 ms there and back, and are lost in part."""

import time
from pathlib import Path

import pytest

from tests.system.net.hosts import needs_root
from tests.system.net.links import ENDS, LINKS, LinkedDaemons, link_run, linked, route
from tests.witness import WATCHDOG_S, Witness

pytestmark = needs_root

CUT_S = 5.0


def test_at_300_ms_the_default_link_opens_within_5_s_and_stays_armed(
    tmp_path: Path, witness_of_daemons: Witness
) -> None:
    with linked(tmp_path, LINKS["default"], route(0.150, 0.150)) as daemons:
        took_s = daemons.open()
        with witness_of_daemons.timely(1.0):
            assert took_s < 5.0
        check_armed(daemons, 1.5, witness_of_daemons)
        daemons.end()


def check_armed(daemons: LinkedDaemons, for_s: float, witness: Witness) -> None:
    """It arms, and nothing stops it; where a late machine does, the stage comes to rest."""
    daemons.wait_armed()
    time.sleep(for_s)
    with witness.timely(WATCHDOG_S):
        assert daemons.count("slave", "armed -> ") == 0, daemons.hosts.last_words()
    stops = daemons.count("slave", " -> stopping, ")
    assert daemons.count("slave", "stopping -> ready, at_rest") in {stops, stops - 1}


@pytest.mark.parametrize(("round_trip_s", "within_s"), [(0.3, 5.0), (0.6, 8.0)])
@pytest.mark.soak
@pytest.mark.timeout(180)
def test_the_default_link_stays_armed_and_comes_back_after_a_cut(
    tmp_path: Path, round_trip_s: float, within_s: float, witness_of_daemons: Witness
) -> None:
    """With `gate.max_round_trip_s` 1.0 at 600 ms."""
    with linked(tmp_path, LINKS["default"], route(round_trip_s / 2, round_trip_s / 2)) as daemons:
        took_s = daemons.open()
        with witness_of_daemons.timely(1.0):
            assert took_s < within_s
        check_armed(daemons, 20.0, witness_of_daemons)
        took_s = daemons.cut(CUT_S)
        with witness_of_daemons.timely(1.0):
            assert took_s < within_s
        daemons.wait_armed()
        daemons.end()


@pytest.mark.soak
@pytest.mark.timeout(120)
def test_a_round_trip_beyond_the_limit_connects_and_does_not_arm_and_both_ends_say_it(tmp_path: Path) -> None:
    """0.9 s, where the default limit is 0.7 s."""
    with linked(tmp_path, LINKS["default"], route(0.450, 0.450), gate={}) as daemons:
        daemons.open()
        time.sleep(10.0)
        assert daemons.count("slave", "-> engaging") == 0
        for role in ENDS:
            assert daemons.count(role, "ms, limit 700 ms") > 0
        daemons.end()


@pytest.mark.parametrize("link", ["default", "udp"])
@pytest.mark.soak
@pytest.mark.timeout(120)
def test_where_packets_are_lost_the_service_stays_armed_and_the_prediction_beats_the_hold(
    tmp_path: Path, link: str, witness_of_daemons: Witness
) -> None:
    loss = 0.005
    run = link_run(tmp_path, LINKS[link], route(0.050, 0.050, loss), 20.0)
    assert run.lost_share("there") == pytest.approx(loss, rel=0.5)
    with witness_of_daemons.timely(WATCHDOG_S):
        assert run.report.armed_share is not None
        assert run.report.armed_share > 0.9
        assert run.report.delay_s.p50 == pytest.approx(0.100, abs=0.010)
        assert run.report.delay_s.p99 is not None
        assert run.report.delay_s.p99 < 0.125
        assert run.report.commands.scored > 10_000
    assert run.report.ratio.rms is not None
    assert run.report.ratio.rms < 0.75
