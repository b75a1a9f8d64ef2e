"""Link, lease and safety in words, never by colour alone."""

from collections.abc import Mapping
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


def word(state: SafetyState) -> str:
    return "emergency stop" if state is SafetyState.ESTOPPED else state.value


Said = Mapping[str, object] | None
SLOW = {"reason": long_round_trip(0.812, 0.7)}
SLIPPED = {"slipped_since_ns": 0, "stamp_ns": 14 * S}
NO_SESSION = {"indication": "no_session", "reason": "settings differ: max_force_n"}
NO_ANSWER = {"indication": "no_session", "reason": "no answer from the slave for 2.0 s"}
LIGHTS: list[tuple[str, Said, Said, float, tuple[str, str, str]]] = [
    # --- the light, what the slave has said, what the master has, s ago, and what is shown ---
    ("link", {}, {}, 0.1, ("good", "linked", "")),
    ("link", {}, None, 0.1, ("off", "waits", "")),
    ("link", None, {}, 0.1, ("off", "waits", "")),
    ("link", None, None, 0.1, ("off", "waits", "")),
    ("link", {}, {}, 3.2, ("bad", "silent", "")),
    ("link", {}, NO_SESSION, 0.1, ("warn", "", "max_force_n")),
    ("link", {}, NO_ANSWER, 0.1, ("off", "", "")),
    ("link", {}, {"indication": "handle_fault", "reason": "unplugged"}, 0.1, ("", "handle fault", "")),
    ("link", {"state": "ready", **SLOW}, {"indication": "ready", **SLOW}, 0.1, ("warn", "too slow", "")),
    ("lease", {}, {}, 0.1, ("good", "held", "")),
    ("lease", {}, {}, 3.2, ("off", "", "")),
    ("lease", {}, None, 0.1, ("", "held", "")),
    ("lease", {"session_id": 0}, {}, 0.1, ("", "free", "")),
    ("lease", {"session_id": 5}, {}, 0.1, ("", "held by another", "")),
    ("deadman", {}, {}, 0.1, ("good", "pressed", "")),
    ("deadman", {}, {}, 3.2, ("off", "", "")),
    ("force", {}, {}, 0.1, ("good", "within limit", "")),
    ("safety", {}, {}, 0.1, ("good", "armed", "")),
    ("safety", {}, {}, 3.2, ("bad", "unknown", "")),
    ("safety", None, None, 0.1, ("off", "unknown", "")),
    *(("safety", {"state": s.value, "reason": "x"}, {}, 0.1, ("", word(s), " · x")) for s in SafetyState),
    ("instrument", {"near_load": BUCKLES}, {}, 0.1, ("warn", "near its load", "")),
    ("instrument", {"slipped_m": 2.1e-3, **SLIPPED}, {}, 0.1, ("warn", "slipped", "2.1 mm lost, first 14 s")),
    ("instrument", SLIPPED, {}, 0.1, ("warn", "slipped", "first 14 s ago")),
]


@pytest.mark.parametrize(("name", "slave", "master", "ago_s", "shown"), LIGHTS)
def test_a_light_has_the_level_and_the_word_of_what_was_said(
    name: str, slave: Said, master: Said, ago_s: float, shown: tuple[str, str, str]
) -> None:
    """An empty text stands for any."""
    view = AxisView()
    for topic, said in ((SLAVE_STATE, slave), (MASTER_STATE, master)):
        if said is not None:
            view.take(topic, usual(topic, **said), S)
    (light,) = (light for light in lights(view, round((1 + ago_s) * S)) if light.name == name)
    _, level, word, more = light
    assert level in get_args(Level)
    assert (shown[0] or level, shown[1] or word) == (level, word)
    assert shown[2] in more


def test_a_session_that_is_gone_is_no_link() -> None:
    view, now_ns = viewed(0.1)
    view.newest.master = usual(MASTER_STATE, indication="no_session", reason="")
    assert lights(view, now_ns)[0][1:3] == ("bad", "no link")


def test_what_an_axis_does_without_is_shown_before_it_is_armed() -> None:
    without = ("unsafe: gate.lease_s = 5",)
    view, now_ns = viewed(0.1)
    view.newest.slave = usual(SLAVE_STATE, state="ready", caveats=without)
    (safety,) = (light for light in lights(view, now_ns) if light.name == "safety")
    assert without[0] in safety[3]
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
    assert (found["delay"], panels.delay(view, now_ns)) == ("300", "median 300 · 99 % 300 · most 300 ms")
    assert panels.delay(view, now_ns + 61 * S).startswith("no answered command")
    assert set(panels.numbers(view, now_ns + S).values()) <= {"–", "", False}


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


def test_energy_below_zero_and_a_loop_that_misses_ticks_are_said() -> None:
    view, now_ns = viewed(0.1)
    assert panels.energy(view, now_ns)["level"] == "good"
    assert panels.energy(view, now_ns + S)["level"] == "off"
    assert view.newest.haptics is not None
    view.newest.haptics = view.newest.haptics.model_copy(update={"energy_j": -0.002})
    assert panels.energy(view, now_ns) | {"words": ""} == {"level": "warn", "value": "-2 mJ", "words": ""}
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
