"""The slave's axis: sessions, commands, stops."""

import re

import pytest

from forefeel.common.codec import encode
from forefeel.common.messages import MOST_QUANTITY, PROTOCOL_VERSION, Grip, SafetyState
from forefeel.common.settings import settings_hash
from forefeel.common.topics import COMMAND, FORCE, LIMIT_EVENT, SLAVE_STATE
from tests.messages import SHARED
from tests.unit.rigs import MS, SESSION, SlaveRig

S = SafetyState


def test_a_master_with_equal_settings_is_accepted(opened: SlaveRig) -> None:
    answer = opened.shake()
    assert (answer.accepted, answer.reason, answer.session_id, answer.role) == (True, "", SESSION, "slave")
    assert (answer.settings_hash, answer.settings, answer.instance_id) == (settings_hash(SHARED), SHARED, 99)
    assert opened.counters()["handshakes_accepted"] == 1


OLDER = SHARED.replace(f'"protocol": {PROTOCOL_VERSION}', '"protocol": 5')


@pytest.mark.parametrize(
    "settings",
    ["", "no JSON", "[" * 4096, '{"cell": "\\ud800\\n\\u0000"}', '{"protocol": 1e999}', SHARED, OLDER],
)
def test_settings_that_are_not_ours_are_refused_in_one_line(opened: SlaveRig, settings: str) -> None:
    protocol, its_hash = (5, settings_hash(OLDER)) if settings == OLDER else (PROTOCOL_VERSION, "0" * 16)
    answer = opened.shake(protocol=protocol, settings=settings, settings_hash=its_hash)
    assert not answer.accepted
    named = f"protocol: {PROTOCOL_VERSION} here, 5 there: " if settings == OLDER else ""
    assert answer.reason.startswith(f"settings differ: {named}")
    assert answer.reason.isprintable()
    assert opened.shake(SESSION + 1).accepted


def test_a_jump_to_the_largest_number_of_a_command_refuses_the_others_and_is_told() -> None:
    rig = SlaveRig().armed()
    rig.put(COMMAND, encode(rig.command().model_copy(update={"sequence": 2**63 - 1})))
    rig.step(200)
    limit = rig.newest(LIMIT_EVENT)
    assert limit.rule in ("sequence", "second_writer")
    assert limit.applied == MOST_QUANTITY


def test_a_repeated_handshake_does_not_reset_the_sequence() -> None:
    rig = SlaveRig().armed()
    recorded = rig.command()
    assert rig.shake().accepted
    before = rig.counters().get("refused_sequence", 0)
    rig.put(COMMAND, encode(recorded))
    assert rig.counters()["refused_sequence"] == before + 1
    rig.step(5)
    assert rig.state() is S.ARMED


@pytest.mark.parametrize(("rate", "way"), [(0.08, "fast"), (-0.083, "slow")])
def test_master_clock_at_a_rate_that_can_not_be_followed_is_a_named_fault(rate: float, way: str) -> None:
    rig = SlaveRig()
    rig.rate = rate
    rig.connected().step(5000)
    assert rig.state() is S.FAULT
    found = re.search(rf"at least (\d+) ppm {way} ", rig.reason)
    assert found is not None and 60_000 < int(found[1]) < 90_000
    rig.axis.clear()
    rig.step(10)
    assert rig.state() is S.FAULT


@pytest.mark.parametrize("played", [False, True])
def test_an_armed_axis_follows_and_each_force_answers_the_command_before(played: bool) -> None:
    """As it is carried on, but for that of a recording, whose cell answers with the force of its moment."""
    rig = SlaveRig().armed()
    sent: list[tuple[int, int, float | None]] = []
    for i in range(20):
        rig.position_m += 1e-5
        time_s = i / 1000 if played else None
        rig.fields = {"recording_time_s": time_s, "velocity_m_s": 0.01}
        rig.step()
        sent.append((rig.newest(COMMAND).sequence, rig.now_ns + (0 if played else MS), time_s))
    answers = [
        (f.answers_sequence, f.answers_stamp_ns, f.recording_time_s) for f in rig.messages(FORCE)[-19:]
    ]
    assert answers == sent[:-1]
    assert rig.load_cell.asked[-19:] == [time_s for *_, time_s in sent[:-1]]
    assert rig.stage.position_m == pytest.approx(rig.position_m, abs=2e-5)


def test_the_grip_of_a_followed_command_reaches_the_gripper() -> None:
    rig = SlaveRig().connected()
    rig.fields = {"gripper": Grip.OPEN}
    rig.step(5)
    assert set(rig.gripper.asked) == {Grip.CLOSED}
    rig.deadman = True
    rig.step(5)
    assert rig.gripper.asked[-1] is Grip.OPEN
    assert rig.state() is S.ENGAGING
    state = rig.newest(SLAVE_STATE)
    assert state.gripper is Grip.OPEN
    assert len(state.caveats) == 3 and state.caveats == rig.axis.settings.caveats


@pytest.fixture
def opened() -> SlaveRig:
    rig = SlaveRig()
    rig.axis.open(rig.now_ns)
    return rig
