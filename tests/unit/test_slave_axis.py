from itertools import pairwise
from math import inf, nan

import msgpack
import pytest

from common import topics
from common.codec import encode
from common.errors import DeviceError
from common.messages import EmergencyStop, Grip, SafetyState
from common.settings import settings_hash
from slave.load_cells.port import LoadCellReading
from tests.unit.slave_rig import MS, SESSION, SHARED, START_M, SlaveRig, other_limits

S = SafetyState


# --- sessions ---


def test_a_master_with_equal_settings_is_accepted() -> None:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    answer = rig.shake()
    assert (answer.accepted, answer.reason, answer.session_id, answer.role) == (True, "", SESSION, "slave")
    assert (answer.settings_hash, answer.settings, answer.instance_id) == (settings_hash(SHARED), SHARED, 99)
    assert rig.counters()["handshakes_accepted"] == 1


def test_a_master_with_other_settings_is_refused_field_by_field() -> None:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    theirs = other_limits(max_velocity_m_s=0.3, workspace_m=(0.0, 0.12))
    answer = rig.shake(settings=theirs, settings_hash=settings_hash(theirs))
    assert not answer.accepted
    assert answer.reason == (
        "settings differ: max_velocity_m_s: 0.2 here, 0.3 there; "
        "workspace_m: [-0.002, 0.12] here, [0.0, 0.12] there"
    )
    rig.step(200)
    assert rig.state() is S.IDLE
    assert rig.counters()["refused_session"] == 200


@pytest.mark.parametrize(
    "settings", ["", "no JSON", "[" * 4096, '{"cell": "\\ud800\\n\\u0000"}', '{"protocol": 1e999}', SHARED]
)
def test_settings_that_are_no_settings_are_refused_in_one_line(settings: str) -> None:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    answer = rig.shake(settings=settings, settings_hash="0" * 16)
    assert not answer.accepted
    assert answer.reason.startswith("settings differ: ")
    assert answer.reason.isprintable()
    assert rig.shake(SESSION + 1).accepted


def test_a_slave_does_not_open_a_session_with_a_slave() -> None:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    assert rig.shake(role="slave").reason == "only a master may open a session"


def test_a_second_master_is_refused_while_the_lease_of_the_first_lives() -> None:
    rig = SlaveRig().armed()
    answer = rig.shake(SESSION + 1)
    assert (answer.accepted, answer.reason) == (False, "another session holds the lease")
    rig.step(50)
    assert rig.state() is S.ARMED
    assert rig.states[-1].session_id == SESSION


def test_the_lease_of_a_silent_master_expires_and_the_next_one_starts_afresh() -> None:
    rig = SlaveRig().armed()
    rig.beating = False
    rig.step(1050)
    assert (rig.state(), rig.states[-1].session_id) == (S.IDLE, 0)
    assert [event.event for event in rig.events][-3:] == ["session_lost", "at_rest", "session_lost"]
    rig.session_id, rig.beating = SESSION + 1, True
    assert rig.shake().accepted
    rig.step(200)  # its deadman is held from the start
    assert rig.state() is S.READY
    rig.deadman = False
    rig.step(2)
    rig.deadman = True
    rig.step(40)
    assert rig.state() is S.ARMED


def test_the_id_of_an_old_session_is_refused_with_everything_recorded_of_it() -> None:
    rig = SlaveRig().connected()
    recorded = rig.command()
    rig.beating = False
    rig.step(1100)
    answer = rig.shake(SESSION)
    assert (answer.accepted, answer.reason) == (False, "this session id was used before")
    assert rig.shake(SESSION + 1).accepted
    refused = rig.counters().get("refused_session", 0)
    rig.put_raw(topics.COMMAND, encode(recorded))
    assert rig.counters()["refused_session"] == refused + 1


def test_a_repeated_handshake_does_not_reset_the_sequence() -> None:
    rig = SlaveRig().armed()
    recorded = rig.command()
    assert rig.shake().accepted
    before = rig.counters().get("refused_sequence", 0)
    rig.put_raw(topics.COMMAND, encode(recorded))
    assert rig.counters()["refused_sequence"] == before + 1
    rig.step(5)
    assert rig.state() is S.ARMED


def test_no_heartbeat_without_a_session_and_then_one_with_the_four_stamps() -> None:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    rig.axis.beat(rig.now_ns)
    assert rig.beats == []
    rig.shake()
    rig.axis.beat(rig.now_ns)
    assert (rig.beats[-1].echo_stamp_ns, rig.beats[-1].echo_receive_ns) == (None, None)
    rig.beat()
    sent_ns = rig.now_ns
    rig.clock.set_ns(sent_ns + 7)
    rig.axis.beat(rig.now_ns)
    assert (rig.beats[-1].session_id, rig.beats[-1].stamp_ns) == (SESSION, sent_ns + 7)
    assert (rig.beats[-1].echo_stamp_ns, rig.beats[-1].echo_receive_ns) == (sent_ns, sent_ns)


def test_heartbeats_of_others_neither_renew_nor_set_the_clock() -> None:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    rig.shake()
    rig.session_id = 1234
    rig.step(1100)
    assert rig.state() is S.IDLE
    assert rig.states[-1].clock_offset_ns is None
    assert rig.states[-1].session_id == 0


# --- commands and answers ---


def test_an_armed_axis_follows_and_each_force_answers_the_command_of_the_tick_before() -> None:
    rig = SlaveRig().armed()
    sent: list[tuple[int, int, float]] = []
    for i in range(20):
        rig.position_m += 1e-5
        rig.fields = {"recording_time_s": i / 1000, "velocity_m_s": 0.01}
        rig.step()
        newest = rig.outlets["master/command"].header(0, 0)["sequence"] - 1
        sent.append((newest, rig.now_ns, i / 1000))
    answers = [(f.answers_sequence, f.answers_stamp_ns, f.recording_time_s) for f in rig.forces[-19:]]
    assert answers == sent[:-1]
    assert rig.load_cell.asked[-19:] == [time_s for *_, time_s in sent[:-1]]
    assert rig.stage.position_m == pytest.approx(rig.position_m, abs=2e-5)


def test_a_force_that_answers_no_command_says_so() -> None:
    rig = SlaveRig().connected()
    assert {f.answers_sequence for f in rig.forces} == {None}
    assert {f.session_id for f in rig.forces[-100:]} == {SESSION}
    assert rig.load_cell.asked == [None] * len(rig.forces)
    assert rig.forces[-1].clock_offset_ns == 0
    assert rig.forces[-1].clock_bound_ns is not None


def test_commands_that_came_between_two_ticks_are_counted_as_superseded() -> None:
    rig = SlaveRig().armed()
    before = rig.counters()["commands_superseded"]
    for _ in range(3):
        rig.command()
    rig.step()
    assert rig.counters()["commands_superseded"] == before + 3


def test_a_release_is_not_lost_to_a_press_that_comes_before_the_tick() -> None:
    rig = SlaveRig().armed()
    rig.clock.set_ns(rig.now_ns + MS)
    rig.deadman = False
    rig.command()
    rig.deadman, rig.position_m = True, START_M + 0.03
    rig.command()
    rig.axis.tick(rig.now_ns)
    rig.step(200)
    assert rig.state() is S.READY
    assert rig.stage.position_m == pytest.approx(START_M, abs=1e-6)
    assert [event.event for event in rig.events][-2:] == ["release", "at_rest"]


@pytest.mark.parametrize(
    "topic",
    [
        topics.COMMAND,
        topics.MASTER_HANDSHAKE,
        topics.MASTER_HEARTBEAT,
    ],
    ids=lambda topic: str(topic.name),
)
def test_malformed_payloads_are_counted_by_topic_and_change_nothing(
    topic: topics.Topic[EmergencyStop],
) -> None:
    rig = SlaveRig().armed()
    for payload in (
        b"",
        b"\x00" * 70_000,
        b"\x93",
        msgpack.packb({"protocol": 1}),
        msgpack.packb({"a": nan}),
    ):
        rig.put_raw(topic, payload)
    rig.step(20)
    assert rig.state() is S.ARMED
    assert rig.counters()[f"malformed_{topic.name.replace('/', '_')}"] == 5


@pytest.mark.parametrize("number", [nan, inf, -inf])
def test_numbers_that_are_not_finite_do_not_arrive(number: float) -> None:
    rig = SlaveRig().armed()
    command = dict(rig.command())
    rig.put_raw(topics.COMMAND, msgpack.packb({**command, "sequence": 10**6, "position_m": number}))
    rig.step(5)
    assert rig.state() is S.ARMED
    assert rig.counters()["malformed_master_command"] == 1


# --- stops ---


def test_an_emergency_stop_from_the_network_stops_in_the_next_tick_and_latches() -> None:
    rig = SlaveRig().armed()
    rig.stop("nurse", "the patient moved")
    rig.step()
    assert (rig.state(), rig.states[-1].reason) == (S.ESTOPPED, "nurse: the patient moved")
    assert rig.stage.holds[-1] == rig.now_ns
    moved = len(rig.stage.commands)
    rig.deadman = False
    rig.step(50)
    rig.deadman = True
    rig.step(200)
    assert rig.state() is S.ESTOPPED
    assert len(rig.stage.commands) == moved


def test_a_stop_that_can_not_be_read_is_a_stop() -> None:
    rig = SlaveRig().armed()
    rig.put_raw(topics.EMERGENCY_STOP, b"\x93")
    rig.step(20)
    assert rig.state() is S.ESTOPPED
    assert rig.counters()["malformed_any_estop"] == 1


def test_a_stop_is_no_command_it_needs_no_session_and_may_be_repeated() -> None:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    rig.sends = False
    payload = encode(EmergencyStop(session_id=0, sequence=0, stamp_ns=-5, source="x", reason=""))
    for _ in range(1000):
        rig.put_raw(topics.EMERGENCY_STOP, payload)
    rig.step(20)
    assert rig.state() is S.ESTOPPED
    assert [event.event for event in rig.events] == ["estop"]


def test_a_reason_of_the_longest_length_can_be_published() -> None:
    rig = SlaveRig().armed()
    rig.stop("s" * 64, "r" * 256)
    rig.step(20)
    assert rig.state() is S.ESTOPPED
    assert rig.events[-1].reason == ("s" * 64 + ": " + "r" * 256)[:256]


def test_only_a_local_clear_ends_it_and_arming_starts_from_the_beginning() -> None:
    rig = SlaveRig().armed()
    rig.stop()
    rig.step(5)
    rig.axis.clear()
    rig.step(100)
    assert rig.state() is S.READY  # the deadman is still held
    rig.deadman = False
    rig.step(2)
    rig.deadman = True
    rig.step(40)
    assert rig.state() is S.ARMED


def test_a_clear_before_the_loop_has_heeded_the_stop_does_not_swallow_it() -> None:
    rig = SlaveRig().armed()
    rig.stop()
    rig.axis.clear()
    rig.step()
    assert rig.state() is S.ESTOPPED


@pytest.mark.parametrize("halt", ["fault", "estop"])
def test_a_clear_swallows_no_stop_that_came_after_what_it_clears(halt: str) -> None:
    rig = SlaveRig().armed()
    if halt == "fault":
        rig.load_cell.error = DeviceError("load cell: unplugged")
        rig.step(2)
        rig.load_cell.error = None
        assert rig.state() is S.FAULT
    else:
        rig.stop()
        rig.step()
    rig.step(50)
    rig.stop("surgeon", "again")
    rig.axis.clear()
    rig.step(5)
    assert (rig.state(), rig.states[-1].reason) == (S.ESTOPPED, "surgeon: again")
    rig.axis.clear()
    rig.step(2)
    assert rig.state() is S.READY


def test_a_fault_that_lasts_outlives_its_clearing() -> None:
    rig = SlaveRig().armed()
    rig.load_cell.error = DeviceError("load cell: unplugged")
    rig.step(2)
    rig.axis.clear()
    rig.step()
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, "load cell: unplugged")


def test_a_clearing_of_nothing_clears_nothing_later() -> None:
    rig = SlaveRig().armed()
    rig.axis.clear()
    rig.step(2)
    rig.stop()
    rig.step(20)
    assert rig.state() is S.ESTOPPED


def test_a_stop_between_the_clear_and_the_next_tick_holds() -> None:
    rig = SlaveRig().armed()
    rig.stop()
    rig.step()
    rig.axis.clear()
    rig.stop("surgeon", "again")
    rig.step(5)
    assert (rig.state(), rig.states[-1].reason) == (S.ESTOPPED, "surgeon: again")


def test_shutting_down_comes_to_rest_and_arms_no_more() -> None:
    rig = SlaveRig().armed()
    rig.axis.shutdown = True
    rig.step(30)
    rig.deadman = False
    rig.step(5)
    rig.deadman = True
    rig.step(50)
    assert (rig.state(), rig.axis.at_rest) == (S.READY, True)


# --- devices that fail ---


@pytest.mark.parametrize("call", ["read", "command"])
def test_a_stage_that_fails_is_a_fault_and_is_told_to_hold(call: str) -> None:
    rig = SlaveRig().armed()
    rig.stage.broken = {call}
    rig.step(2)
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, f"stage: {call} refused")
    rig.stage.broken = set()
    rig.step(100)
    assert rig.state() is S.FAULT
    assert rig.stage.holds[-1] == rig.now_ns
    rig.axis.clear()
    rig.step(2)
    assert rig.state() is S.READY


def test_a_stage_that_can_not_even_hold_is_a_fault_and_the_loop_goes_on() -> None:
    rig = SlaveRig().armed()
    rig.stage.broken = {"read", "command", "hold"}
    rig.step(20)
    assert rig.state() is S.FAULT
    assert len(rig.forces) == len(rig.load_cell.asked) + 20
    assert {force.valid for force in rig.forces[-19:]} == {False}


def test_a_gripper_or_load_cell_that_fails_is_a_fault() -> None:
    rig = SlaveRig().armed()
    rig.gripper.broken = True
    rig.step(2)
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, "gripper: jammed")
    rig = SlaveRig().armed()
    rig.load_cell.error = DeviceError("load cell: unplugged")
    rig.step()
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, "load cell: unplugged")
    assert (rig.forces[-1].valid, rig.forces[-1].force_n) == (False, 0.0)


@pytest.mark.parametrize("force_n", [nan, inf, -inf])
def test_a_force_that_is_not_finite_is_a_fault_and_never_published(force_n: float) -> None:
    rig = SlaveRig().armed()
    rig.load_cell.reading = LoadCellReading(force_n, 0, True)
    rig.step()
    assert rig.state() is S.FAULT
    assert rig.states[-1].reason == f"load cell = {force_n} N: expected a finite force"
    assert (rig.forces[-1].valid, rig.forces[-1].force_n) == (False, 0.0)
    assert rig.stage.holds[-1] == rig.now_ns


@pytest.mark.parametrize("field", ["position_m", "velocity_m_s"])
def test_a_readback_that_is_not_finite_is_a_fault_and_the_last_one_stays(field: str) -> None:
    rig = SlaveRig().armed()
    rig.deadman = False
    rig.step(5)
    setattr(rig.stage, field, nan)
    rig.step()
    assert rig.state() is S.FAULT
    assert "expected finite numbers" in rig.states[-1].reason
    assert rig.forces[-1].position_m == pytest.approx(START_M)


def test_an_axis_does_not_open_on_a_stage_that_does_not_say_where_it_is() -> None:
    rig = SlaveRig()
    rig.stage.position_m = nan
    with pytest.raises(DeviceError, match="expected finite numbers"):
        rig.axis.open(rig.now_ns)
    rig.stage.position_m, rig.stage.broken = START_M, {"open"}
    with pytest.raises(DeviceError, match="open refused"):
        rig.axis.open(rig.now_ns)


def test_a_fault_of_any_thread_holds_the_stage_at_once_and_is_a_fault_at_the_next_tick() -> None:
    rig = SlaveRig().armed()
    holds = len(rig.stage.holds)
    rig.axis.fail(ValueError("torn cable"))
    assert len(rig.stage.holds) == holds + 1
    rig.step()
    assert (rig.state(), rig.states[-1].reason) == (S.FAULT, "ValueError: torn cable")


def test_a_stage_that_can_not_hold_at_a_fault_is_counted() -> None:
    rig = SlaveRig().armed()
    rig.stage.broken = {"hold"}
    rig.axis.fail(ValueError())
    rig.stage.broken = set()
    assert rig.counters()["hold_failed"] == 1


def test_a_load_cell_that_stays_invalid_is_a_fault_only_while_the_stage_follows() -> None:
    rig = SlaveRig()
    rig.load_cell.reading = LoadCellReading(0.0, 0, False)
    rig.connected()
    rig.step(500)
    assert rig.state() is S.READY
    rig.deadman = True
    rig.step(199)
    assert rig.state() is S.ARMED
    rig.step(5)
    assert rig.state() is S.FAULT


# --- interventions ---


def total(rig: SlaveRig, rule: str) -> int:
    return sum(event.count for event in rig.limits if event.rule == rule)


def test_interventions_are_gathered_in_at_most_ten_events_a_second_and_all_counted() -> None:
    rig = SlaveRig().armed()
    rig.position_m = 0.5 * START_M
    rig.fields = {"velocity_m_s": -3.0}  # beyond all reason: refused
    before = rig.counters().get("refused_range", 0)
    rig.sends = True
    for _ in range(55):  # not so many that the watchdog fires
        rig.step()
    rig.fields = {}
    rig.position_m = rig.stage.position_m
    rig.step(300)
    refused = rig.counters()["refused_range"] - before
    assert refused == 55
    assert total(rig, "range") == 55
    assert len([event for event in rig.limits if event.rule == "range"]) == 2
    event = next(event for event in rig.limits if event.rule == "range")
    assert (event.requested, event.applied, event.unit) == (-3.0, 2.0, "m/s")


def test_every_intervention_of_the_loop_is_counted_once() -> None:
    rig = SlaveRig().armed()
    rig.position_m = 0.18  # beyond reason, which ends 50 mm outside of the workspace
    rig.step(20)
    rig.position_m = 0.16  # outside of the workspace only
    rig.step(700)
    rig.deadman = False
    rig.step(300)
    published = {rule: total(rig, rule) for rule in {event.rule for event in rig.limits}}
    assert published["range"] == 20
    assert published["workspace"] == 700
    assert sum(published.values()) == rig.counters()["limit_interventions"]
    times_ns = [event.stamp_ns for event in rig.limits if event.rule == "workspace"]
    assert all(later - earlier >= 100 * MS for earlier, later in pairwise(times_ns))
    assert rig.stage.position_m <= 0.12 + 1e-12


def test_what_was_gathered_at_the_end_is_published_at_the_end() -> None:
    rig = SlaveRig().armed()
    rig.fields = {"velocity_m_s": -3.0}
    rig.step(30)
    assert total(rig, "range") < 30
    rig.axis.serve(rig.now_ns, last=True)
    assert total(rig, "range") == rig.counters()["refused_range"] == 30


def test_a_drive_that_does_not_go_where_it_is_told_is_an_intervention() -> None:
    rig = SlaveRig().armed()
    rig.stage.travel_m = (0.0, START_M + 0.001)
    rig.position_m = START_M + 0.002
    rig.step(40)
    assert total(rig, "travel") > 0
    event = next(event for event in rig.limits if event.rule == "travel")
    assert (event.applied, event.unit) == (START_M + 0.001, "m")
    assert event.requested > event.applied


def test_a_replayed_flood_is_counted_and_moves_nothing() -> None:
    rig = SlaveRig().armed()
    recorded = encode(rig.command())
    before = rig.counters().get("refused_sequence", 0)
    for _ in range(1000):
        rig.put_raw(topics.COMMAND, recorded)
    rig.step(20)
    assert rig.state() is S.ARMED
    assert rig.counters()["refused_sequence"] == before + 1000
    assert len(rig.limits) <= 3


# --- states ---


def test_the_watchdog_stops_the_stage_and_every_transition_is_published_with_its_reason() -> None:
    rig = SlaveRig().armed()
    rig.sends = False
    rig.step(100)
    told = [(event.before.value, event.event, event.after.value) for event in rig.events]
    assert told == [
        ("idle", "session_opened", "ready"),
        ("ready", "engage", "engaging"),
        ("engaging", "engaged", "armed"),
        ("armed", "watchdog", "stopping"),
        ("stopping", "at_rest", "ready"),
    ]
    assert rig.events[3].reason == "no valid command for 61 ms"
    assert [event.sequence for event in rig.events] == [1, 2, 3, 4, 5]
    assert rig.states[-1].stops == 1


def test_the_grip_of_a_followed_command_reaches_the_gripper() -> None:
    rig = SlaveRig().connected()
    rig.fields = {"gripper": Grip.OPEN}
    rig.step(5)
    assert set(rig.gripper.asked) == {Grip.CLOSED}
    rig.deadman = True
    rig.step(5)
    assert rig.gripper.asked[-1] is Grip.OPEN
    assert rig.state() is S.ENGAGING
    assert rig.states[-1].gripper is Grip.OPEN


def test_without_open_there_is_nothing_to_stop() -> None:
    rig = SlaveRig()
    assert (rig.axis.at_rest, rig.axis.halted) == (True, False)
