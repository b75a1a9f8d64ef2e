"""Link, lease and safety in words, never by colour alone."""

from typing import get_args

import pytest

from forefeel.common.events.text import BUCKLES, long_round_trip
from forefeel.common.messages import SafetyState
from forefeel.common.topics import MASTER_STATE, MASTER_TIMING, PARAMETERS, SLAVE_STATE, SLAVE_TIMING
from forefeel.dashboard import panels
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.detector import Alarm
from forefeel.dashboard.event_log import Level
from forefeel.dashboard.indicators import lights
from tests.messages import usual
from tests.unit.dashboard.talk import HOSTILE, S, viewed


def told(
    slave: dict[str, object] | None = None, master: dict[str, object] | None = None, later_s: float = 0.1
) -> dict[str, tuple[str, str, str]]:
    view = AxisView()
    if slave is not None:
        view.take(SLAVE_STATE, usual(SLAVE_STATE, **slave), S)
    if master is not None:
        view.take(MASTER_STATE, usual(MASTER_STATE, **master), S)
    return {light.name: light[1:] for light in lights(view, round((1 + later_s) * S))}


def test_all_is_well() -> None:
    found = told({}, {})
    assert [each[:2] for each in found.values()] == [
        ("good", "linked"), ("good", "held"), ("good", "armed"), ("good", "pressed"),
        ("good", "within limit"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("state", "word", "more"),
    [
        ({"near_load": BUCKLES}, "near its load", "the wire is about to bow out"),
        (
            {"slipped_m": 2.1e-3, "slipped_since_ns": 0, "stamp_ns": 14 * S},
            "slipped",
            "about 2.1 mm lost, first 14 s",
        ),
        ({"slipped_since_ns": 0, "stamp_ns": S}, "slipped", "first 1.0 s ago"),
    ],
)
def test_a_wire_that_gives_way_at_the_gripper_is_a_warning(
    state: dict[str, object], word: str, more: str
) -> None:
    level, *texts = told(state, {})["instrument"]
    assert (level, texts[0]) == ("warn", word)
    assert texts[1].startswith(more)


@pytest.mark.parametrize(("slave", "master"), [({}, None), (None, {}), (None, None)])
def test_an_end_that_was_not_heard_yet_is_no_alarm(
    slave: dict[str, object] | None, master: dict[str, object] | None
) -> None:
    assert told(slave, master)["link"][:2] == ("off", "waits")


def test_silence_is_no_state() -> None:
    found = told({}, {}, later_s=3.2)
    assert found["link"][:2] == ("bad", "silent")
    assert found["safety"][:2] == ("bad", "unknown")
    assert found["lease"][0] == found["deadman"][0] == "off"
    assert told()["safety"][:2] == ("off", "unknown")


@pytest.mark.parametrize(
    ("slave", "master", "word"),
    [({"session_id": 0}, {}, "free"), ({"session_id": 5}, {}, "held by another"), ({}, None, "held")],
)
def test_who_holds_the_lease(slave: dict[str, object], master: dict[str, object] | None, word: str) -> None:
    assert told(slave, master)["lease"][1] == word


def test_why_there_is_no_session() -> None:
    found = told({}, {"indication": "no_session", "reason": "settings differ: max_force_n"})
    assert found["link"][0] == "warn"
    assert "max_force_n" in found["link"][2]
    assert (
        told({}, {"indication": "no_session", "reason": "no answer from the slave for 2.0 s"})["link"][0]
        == "off"
    )
    view, now_ns = viewed(0.1)  # which had a session
    view.newest.master = usual(MASTER_STATE, indication="no_session", reason="")
    assert lights(view, now_ns)[0][1:3] == ("bad", "no link")
    assert told({}, {"indication": "handle_fault", "reason": "unplugged"})["link"][1] == "handle fault"


def test_a_round_trip_at_which_nothing_arms_is_no_good_link() -> None:
    reason = long_round_trip(0.812, 0.7)
    found = told({"state": "ready", "reason": reason}, {"indication": "ready", "reason": reason})
    assert found["link"][:2] == ("warn", "too slow")


@pytest.mark.parametrize("state", list(SafetyState))
def test_every_safety_state_has_a_word_and_a_level(state: SafetyState) -> None:
    level, word, more = told({"state": state.value, "reason": "x"}, {})["safety"]
    assert level in get_args(Level)
    assert word == ("emergency stop" if state is SafetyState.ESTOPPED else state.value)
    assert more.endswith(" · x")


def test_what_an_axis_does_without_is_shown_before_it_is_armed() -> None:
    without = ("unsafe: gate.lease_s = 5",)
    assert without[0] in told({"state": "ready", "caveats": without}, {})["safety"][2]
    view, now_ns = viewed(0.1)
    view.newest.slave = usual(SLAVE_STATE, caveats=without)
    assert without[0] in panels.counted(view, now_ns)


def test_counters_by_what_they_mean() -> None:
    view, now_ns = viewed(0.1)
    slave = {"refused_late": 7, "refused_sequence": 3, "refused_session": 2, "steps": 9, "zero": 0}
    view.newest.slave = usual(SLAVE_STATE, counters=slave)
    view.newest.master = usual(MASTER_STATE, counters={"forces_reordered": 2, "forces_dropped": 4})
    said = "7 late · 5 reordered · 4 lost · 7 refused"
    assert panels.counted(view, now_ns, {"malformed": 5}) == said
    assert panels.counted(view, now_ns + S).endswith("· slave not heard now · master not heard now")


def test_figures_are_those_of_the_messages() -> None:
    view, now_ns = viewed(3.0)
    assert view.newest.haptics is not None
    found = panels.numbers(view, now_ns)
    assert found["felt"] == f"{view.newest.haptics.rendered_n:.3f}"
    assert found["predicted"] == f"{view.newest.haptics.predicted_n:.3f}"
    assert found["measured"] == f"{view.newest.haptics.zoh_n:.3f}"
    assert found["delay"] == "300"
    assert set(panels.numbers(view, now_ns + S).values()) <= {"–", "", False}


def test_the_delay_is_that_of_the_last_minute() -> None:
    view, now_ns = viewed(2.0)
    assert panels.delay(view, now_ns) == "median 300 · 99 % 300 · most 300 ms"
    assert panels.delay(view, now_ns + 61 * S).startswith("no answered command")


def test_what_is_known_of_the_model() -> None:
    view, now_ns = viewed(1.0)
    found = panels.model(view, now_ns)
    assert found["parameters"][0] == {
        "name": "stiffness", "value": "12", "deviation": "0.3", "unit": "N/m", "known": "well",
    }  # fmt: skip
    assert found["parameters"][1]["known"] == "not yet"
    assert found["friction"] == {"valve_mn": pytest.approx(80.0)}
    view.newest.model = usual(PARAMETERS, valid=False, identifiable=(HOSTILE,))
    assert panels.model(view, now_ns)["statements"][1:] == [HOSTILE]


def test_energy_below_zero_is_said() -> None:
    view, now_ns = viewed(0.1)
    assert panels.energy(view, now_ns)["level"] == "good"
    assert panels.energy(view, now_ns + S)["words"] == "no hand heard"
    assert view.newest.haptics is not None
    view.newest.haptics = view.newest.haptics.model_copy(update={"energy_j": -0.002})
    assert panels.energy(view, now_ns) | {"words": ""} == {"level": "warn", "value": "-2 mJ", "words": ""}


def test_a_loop_that_misses_ticks_is_said() -> None:
    view, now_ns = viewed(0.1)
    view.newest.heard_ns |= {MASTER_TIMING.name: now_ns, SLAVE_TIMING.name: now_ns}
    view.newest.timings = {"master": usual(MASTER_TIMING), "slave": usual(MASTER_TIMING, missed=9_000)}
    assert [loop["word"] for loop in panels.loops(view, now_ns)] == ["on time", "misses"]
    assert {loop["word"] for loop in panels.loops(view, now_ns + 4 * S)} == {"not heard"}


def test_gain_is_error_beside_late_error() -> None:
    view, now_ns = viewed(3.0)
    assert panels.gain(view, now_ns) == {
        "level": "good", "name": "error, 300 ms ahead", "error": "0.0", "more": "the late force has 132 mN",
    }  # fmt: skip
    for unjudged, at_ns in ((view, now_ns + 30 * S), viewed(0.5)):
        assert panels.gain(unjudged, at_ns)["error"] == "–"


def test_watch_says_since_when_the_model_is_wrong() -> None:
    view, now_ns = viewed(3.0)
    assert panels.watch(view, now_ns)["word"] == "Yes"
    assert panels.watch(view, now_ns + 3 * S)["word"] == "Not known yet"
    for tick in range(2000):
        view.watch.innovation(view.timeline.now_s(now_ns) + 1e-3 * tick, 0.01)
        view.watch.force(view.timeline.now_s(now_ns) + 1e-3 * tick, outside=True)
    assert panels.watch(view, now_ns)["word"] == "Not yet"
    view.watch.alarm = Alarm(view.timeline.now_s(now_ns) - 5.0, 3.2, 0.4)
    card = panels.watch(view, now_ns)
    assert (card["word"], card["level"]) == ("No", "warn")
    assert card["since_s"] == pytest.approx(now_ns * 1e-9 - 5.0, abs=0.06)
    assert card["signs"].startswith("errors of the model at worst 3.2 × the usual · 40 % of the forces")
    assert "forefeel diagnose" in card["next"]
