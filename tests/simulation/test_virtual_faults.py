"""The whole system in virtual time when something goes wrong: limits, stalls, deaths, stops."""

from typing import Any

import numpy as np
import pytest

from forefeel.common.topics import (
    COMMAND,
    FORCE,
    HAPTICS,
    LIMIT_EVENT,
    MASTER_STATE,
    PARAMETERS,
    SAFETY_EVENT,
    SLAVE_STATE,
)
from tests.simulation.pair import DELAY_S, OVERSHOOT, Pair, S

TICK_S = 0.001
WATCHDOG_S = 0.060
MAX_AGE_S = 0.100


def limited(**limits: object) -> dict[str, Any]:
    return {"axes": [{"limits": limits}]}


def test_the_stage_never_leaves_limits_that_the_operator_would() -> None:
    limits = limited(
        workspace_m=(-0.002, 0.020), max_velocity_m_s=0.02, max_acceleration_m_s2=0.5, max_force_n=0.15
    )
    pair = Pair(limits, limits)
    pair.run(4)  # in and out
    position_m, velocity_m_s, force_n = (
        pair.traffic.column(FORCE, name) for name in ("position_m", "velocity_m_s", "force_n")
    )
    asked_m = pair.traffic.column(COMMAND, "position_m")
    assert asked_m.max() > 0.030
    assert position_m.min() > -0.002
    assert position_m.max() <= 0.020
    assert np.abs(np.diff(position_m)).max() <= OVERSHOOT * 0.02 * TICK_S + 1e-6  # a step of the encoder
    assert np.abs(velocity_m_s).max() <= OVERSHOOT * 0.02
    assert np.abs(np.diff(velocity_m_s)).max() <= OVERSHOOT * 0.5 * TICK_S
    assert force_n.max() < 0.15 * 1.25  # without the limit 0.25 N; the stage brakes in 0.4 mm, the servo lags
    rules = {event.rule for event in pair.traffic.messages(LIMIT_EVENT)}
    assert {"workspace", "velocity", "acceleration", "force"} <= rules
    published = sum(event.count for event in pair.traffic.messages(LIMIT_EVENT))
    assert 0 <= pair.traffic.newest(SLAVE_STATE).counters["limit_interventions"] - published < 400


@pytest.mark.parametrize(("stall_s", "sessions"), [(0.3, 1), (2.0, 2)])
def test_a_stall_stops_the_stage_and_its_burst_of_old_commands_moves_nothing(
    stall_s: float, sessions: int
) -> None:
    """One that outlives the session gets another one."""
    pair = Pair()
    start_s = pair.run(1.7137)  # amid the first stroke
    pair.to_slave.stalls.append((start_s, start_s + stall_s))
    pair.run(stall_s + (1.2 if sessions == 1 else 2.8))
    traffic = pair.traffic
    stops_s = traffic.times("watchdog")
    assert len(stops_s) == 1
    # the last command came in after the cable's delay and one tick
    assert start_s + DELAY_S + WATCHDOG_S - TICK_S < stops_s[0] < start_s + DELAY_S + WATCHDOG_S + 2 * TICK_S
    again_s = next(time_s for time_s in traffic.times("engage") if time_s > stops_s[0])
    assert again_s > start_s + stall_s
    time_s = traffic.column(FORCE, "stamp_ns") / S
    position_m, velocity_m_s = (traffic.column(FORCE, name) for name in ("position_m", "velocity_m_s"))
    rest_s = next(time_s for time_s in traffic.times("at_rest") if time_s >= stops_s[0])
    assert np.abs(velocity_m_s[np.searchsorted(time_s, stops_s[0])]) > 0.005
    assert rest_s - stops_s[0] < 0.2 / 4.0 + 0.05 + TICK_S  # from full speed at 4 m/s^2; seen for 50 ms
    resting = (time_s > rest_s + 0.1) & (time_s < again_s)
    assert resting.sum() > 300
    assert np.ptp(position_m[resting]) <= 1e-6
    assert np.abs(velocity_m_s[resting]).max() < 1e-5
    ages_s = time_s - traffic.column(FORCE, "answers_stamp_ns") / S
    assert np.nanmax(ages_s) < DELAY_S + WATCHDOG_S + 3 * TICK_S
    state = traffic.newest(SLAVE_STATE)
    assert (state.stops, state.state.value) == (1, "armed")
    # commands of the last 100 ms of the stall are fresh enough, though nothing follows them; the loop takes
    # the burst in several ticks, in which some become too old, and the rest is of a session that is over
    refused = sum(state.counters.get(f"refused_{rule}", 0) for rule in ("late", "session"))
    assert refused > (stall_s - MAX_AGE_S) * 1000 - 2
    assert len({sample.session_id for sample in traffic.messages(COMMAND)}) == sessions
    assert state.counters["handshakes_accepted"] >= sessions
    for lost_s, opened_s in zip(
        traffic.times("session_lost"), traffic.times("session_opened")[1:], strict=True
    ):
        assert start_s + 0.9 < lost_s < start_s + 1.0 + 0.1  # the lease, from the last heartbeat
        assert start_s + stall_s < opened_s < start_s + stall_s + 0.5


def test_a_way_that_became_longer_for_good_stops_and_is_measured_anew_by_a_new_session() -> None:
    pair = Pair()
    start_s = pair.run(2.0)
    pair.to_slave.delay_s = DELAY_S + 0.150
    pair.run(5.5)
    lost = [m for m in pair.traffic.messages(SAFETY_EVENT) if m.event == "session_lost"]
    assert start_s < pair.traffic.times("watchdog")[0] < start_s + 0.150 + 0.1
    assert [m.before.value for m in lost] == ["ready"]
    assert lost[0].reason.startswith("commands come late all the time")
    assert start_s + 3.0 < lost[0].stamp_ns / S < start_s + 3.5
    assert pair.traffic.newest(SLAVE_STATE).state.value == "armed"
    assert len({sample.session_id for sample in pair.traffic.messages(COMMAND)}) == 2
    delay_s = pair.traffic.column(HAPTICS, "delay_s")[-1]
    assert delay_s == pytest.approx(2 * DELAY_S + 0.150, abs=3 * TICK_S)


def test_forces_that_stand_still_fade_from_the_hand_and_the_slave_is_let_go() -> None:
    pair = Pair()
    start_s = pair.run(2.0)
    pair.to_master.stalls.append((start_s, start_s + 2.0))
    pair.run(4.0)
    time_s = pair.traffic.column(HAPTICS, "stamp_ns") / S
    rendered_n = pair.traffic.column(HAPTICS, "rendered_n")
    blind = (time_s > start_s + DELAY_S + 0.1 + 0.2 + 2 * TICK_S) & (time_s < start_s + 2.0)
    assert blind.sum() > 200
    assert not rendered_n[blind].any()
    assert np.abs(np.diff(rendered_n)).max() <= 80.0 * TICK_S + 1e-9
    released_s = pair.traffic.times("release")[0]
    assert released_s < start_s + 0.5 + 2 * DELAY_S + 0.020 + 3 * TICK_S  # a state is stale after 0.5 s
    assert pair.traffic.times("engaged")[-1] > start_s + 2.0
    assert pair.traffic.newest(SLAVE_STATE).state.value == "armed"


def test_a_slave_whose_host_was_started_again_is_seen_and_learned_from() -> None:
    """Its clock starts anew, and its first messages are lost."""
    pair = Pair(slave_clock_ns=1000 * S)
    pair.run(2.0)
    pair.slave.transport.close()
    died_s = pair.run(1.0)
    pair.to_master.cuts.append((died_s, died_s + 0.1))
    pair.start_slave()
    pair.run(2.5)
    assert pair.traffic.newest(MASTER_STATE).indication == "armed"
    learned = [(m.stamp_ns / S, m.samples) for m in pair.traffic.messages(PARAMETERS)]
    before = max(samples for time_s, samples in learned if time_s < died_s)
    assert learned[-1][1] not in (0, before)
    assert learned[-1][1] > learned[-10][1]


def two_axes(**limits: object) -> dict[str, Any]:
    turn = {"kind": "rotation", "workspace_m": (-0.05, 0.05), **limits}
    return {"axes": [{"name": "insertion"}, {"name": "rotation", "limits": turn}]}


def test_two_axes_run_in_one_pair_and_a_stop_of_one_stops_both() -> None:
    pair = Pair(two_axes(), two_axes())
    stopped_s = pair.run(2.0)
    axes = ["insertion", "rotation"]
    for axis in axes:
        assert pair.traffic.newest(SLAVE_STATE, axis).state.value == "armed"
        assert np.abs(pair.traffic.column(FORCE, "velocity_m_s", axis)).max() > 0.005
    pair.master.axes[1].emergency_stop("smoke", pair.runtime.clock.now_ns())
    pair.run(1.0)
    for axis in axes:
        (halt_s,) = pair.traffic.times("estop", axis)
        assert stopped_s < halt_s <= stopped_s + DELAY_S + 3 * TICK_S
        time_s = pair.traffic.column(FORCE, "stamp_ns", axis) / S
        assert np.ptp(pair.traffic.column(FORCE, "position_m", axis)[time_s > halt_s + 0.15]) <= 1e-6
        assert pair.traffic.events(axis)[-1][1] == "estop"
    assert pair.traffic.messages(SLAVE_STATE, "rotation")[-1].reason == "master: smoke"
    assert "rotation" in pair.traffic.messages(SLAVE_STATE, "insertion")[-1].reason
    pair.slave.axes[1].clear()
    pair.run(0.5)  # one alone can not be cleared
    assert [pair.traffic.newest(SLAVE_STATE, axis).state.value for axis in axes] == ["estopped"] * 2
    for axis_ in pair.slave.axes:
        axis_.clear()
    pair.run(1.2)
    assert [pair.traffic.newest(SLAVE_STATE, axis).state.value for axis in axes] == ["armed"] * 2
