import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from forefeel.common import topics
from forefeel.common.error_size import ErrorSize
from forefeel.common.errors import RunError
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.loopback.outcome import amber_lines, require_armed
from forefeel.report.model import LoopFigures, Loops, RunReport
from forefeel.report.page import ten_lines
from forefeel.report.summary import summarise
from forefeel.report.wording import DISCLAIMER
from tests.unit.report_run import SESSION, RunBuilder, S, write_known_run


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> RunReport:
    path = tmp_path_factory.mktemp("run") / "recording.mcap"
    write_known_run(path)
    return summarise(Run(path))


def test_scores_are_exact(report: RunReport) -> None:
    assert report.commands.model_dump() == {
        "sent": 1000, "answered": 1000, "scored": 1000,
        "reasons": {"not_followed": 0, "skipped": 0, "invalid_force": 0, "not_predicted": 0},
    }  # fmt: skip
    assert report.prediction.rms_n == pytest.approx(1e-3 * np.sqrt(1001 * 2001 / 6))
    assert report.prediction.p95_n == pytest.approx(0.95005)
    assert report.prediction.max_n == pytest.approx(1.0)
    assert report.zoh.rms_n == pytest.approx(2e-3 * np.sqrt(1001 * 2001 / 6))
    assert report.ratio == pytest.approx(0.5)
    # settled is from 3 s after the first on; commands come every 5 ms
    settled_n = 1e-3 * np.sqrt(np.mean(np.arange(601, 1001) ** 2.0))
    assert report.settled.commands == 400
    assert report.settled.prediction.rms_n == pytest.approx(settled_n)


class Recorded(RunBuilder):
    """A run that a test writes, and its report."""

    def __init__(self, path: Path) -> None:
        self.path, self.writer = path, RunWriter(path)
        super().__init__(self.writer)

    def report(self) -> RunReport:
        """Closes the run; its report is JSON without numbers that are none, and comes back as it was."""
        self.writer.close()
        report = summarise(Run(self.path))
        parsed = json.loads(report.to_json(), parse_constant=pytest.fail)
        assert RunReport.model_validate(parsed) == report
        assert next(iter(parsed.items())) == ("schema", "forefeel.report/1")
        return report


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Recorded]:
    recorded = Recorded(tmp_path / "run.mcap")
    yield recorded
    recorded.writer.close()


def test_delay_armed_share_and_counters_are_exact(report: RunReport) -> None:
    delay = report.delay_s
    assert (delay.p50, delay.p99, delay.max, delay.mean) == pytest.approx((0.051, 0.100, 0.101, 0.051))
    assert report.force_age_s.p50 == pytest.approx(0.101 / 2)
    assert report.armed_share == pytest.approx(6.0 / (8.0 - 0.5))
    assert report.stops == 2
    assert report.counters == {
        "limit_velocity": 7, "master_forces_unused": 3, "safety_engage": 1, "slave_refused_late": 10_000,
        "stops": 2, "impairment_master_inbound_messages": 4, "impairment_master_inbound_dropped": 1,
        "impairment_master_inbound_duplicated": 1, "impairment_master_inbound_delayed": 3,
    }  # fmt: skip
    assert all(type(count) is int for count in report.counters.values())


def test_the_last_word_counts(report: RunReport) -> None:
    assert report.loop.master.ticks == report.loop.slave.ticks == 9900
    assert report.loop.slave.p99_us == 110.5
    assert report.loop.slave.scheduling == "SCHED_FIFO 50"
    assert [(p.name, p.standard_deviation) for p in report.parameters] == [
        ("bias.force_n", 0.25), ("spring.stiffness_n_m", 0.125)
    ]  # fmt: skip
    assert report.parameters[1].value == pytest.approx(7.95)
    assert report.identifiable == ("m and k only as k - 0.99 m",)
    assert json.loads(report.settings) == {"axis": "insertion", "max_force_n": 3.0}


@pytest.mark.parametrize(
    "late_ms",
    [
        lambda t_ms: 30 + (400 if 900 <= t_ms < 1100 else 0),  # the recorder stalls
        lambda t_ms: 4 * t_ms,  # it falls behind by more with each message
        lambda t_ms: 0 if t_ms < 2000 else 3_600_000,  # the clock of a host began again
        lambda t_ms: 0 if t_ms < 2000 else -3_600_000,
    ],
)
def test_armed_share_is_that_of_stamps_not_of_arrivals(run: Recorded, late_ms: Callable[[int], int]) -> None:
    for t_ms in range(0, 4000, 20):
        run.late_ms = late_ms(t_ms)
        sent_ms = t_ms - (run.late_ms if abs(run.late_ms) == 3_600_000 else 0)
        run.slave_state(sent_ms, S.ARMED if 1000 <= t_ms < 3000 else S.READY)
    run.late_ms = 0
    run.say(topics.MASTER_STATE, 4030)
    assert run.report().armed_share == pytest.approx(2.0 / 3.0, rel=0.02)


def test_only_valid_answers_of_the_same_session_count(run: Recorded) -> None:
    run.haptics(0, 1, predicted_n=2.0, zoh_n=4.0)
    run.haptics(1, 2, predicted_n=2.0, zoh_n=4.0)
    run.haptics(2, 1, predicted_n=2.0, zoh_n=4.0, session_id=SESSION + 1)
    run.force(3, 50.0, answers=1, valid=False)
    run.force(5, 3.0, answers=1, session_id=SESSION + 1)
    run.force(4, 1.0, answers=1)
    run.force(6, 60.0, answers=None)
    report = run.report()
    assert (report.commands.sent, report.commands.answered, report.commands.scored) == (3, 2, 2)
    assert report.prediction.rms_n == pytest.approx(1.0)
    assert report.zoh.max_n == pytest.approx(3.0)


def test_an_empty_run_has_no_figures(run: Recorded) -> None:
    report = run.report()
    assert report.prediction == ErrorSize(None, None, None)
    assert (report.armed_share, report.axes) == (None, {})
    assert len(report.notes) == 1


@pytest.mark.parametrize(("present", "missing"), [("master", "slave"), ("slave", "master")])
def test_a_run_of_one_end_says_so(run: Recorded, present: str, missing: str) -> None:
    if present == "master":
        run.haptics(0, 1, predicted_n=1.0)
        run.say(topics.MASTER_STATE, 10)
    else:
        run.force(0, 1.0, answers=None)
        run.slave_state(10, S.READY, caveats=("unsafe: x = 1",))
        run.say(
            topics.SLAVE_HANDSHAKE, 20, settings='{"axis": "\\ud800"}', reason="settings differ: max_force_n"
        )
    report = run.report()
    notes = " ".join(report.notes)
    assert missing in notes
    assert report.prediction.rms_n is None and report.transparency is None
    assert (report.stops is None) == (missing == "slave")
    for said in ("unsafe: x = 1", "settings differ: max_force_n"):  # an axis does without, a refused session
        assert (said in notes) == (present == "slave")


@pytest.mark.parametrize("scale", [2.0, None])
def test_without_a_twin_the_measured_force_judges_the_felt_one(run: Recorded, scale: float | None) -> None:
    measured_n = 0.3 * np.sin(np.arange(600) / 40.0)
    run.say(topics.MASTER_STATE, 0, force_scale=scale)
    for k in range(20, 600):
        run.haptics(10 * k, k, predicted_n=2.0 * measured_n[k], zoh_n=measured_n[k - 20])
        run.force(10 * k + 50 + k % 40, measured_n[k], answers=k)  # its way takes 50 to 89 ms
    felt = run.report().transparency_as_measured
    if scale is None:
        assert felt is None
        return
    assert felt is not None
    assert (felt.commands, felt.felt.max_n, felt.within_jnd) == (580, 0.0, 1.0)
    assert felt.held.max_n == pytest.approx(2.0 * 0.6 * np.sin(0.25), rel=0.01)
    assert felt.offset_s == pytest.approx(0.0, abs=1e-6)
    assert felt.held_offset_s == pytest.approx(0.2, abs=1e-3)


def test_only_what_changed_a_motion_counts_as_limited(run: Recorded) -> None:
    rules = ("velocity", "force", "travel", "late", "sequence", "session", "range", "alignment", "round_trip")
    for t_ms, rule in enumerate(rules):
        run.say(topics.LIMIT_EVENT, t_ms, rule=rule, count=10**t_ms)
    report = run.report()
    assert report.counters["limit_late"] == 1000
    assert "111 motions limited" in ten_lines(report)[7]


def test_stops_before_the_recording_do_not_count_and_those_after_a_new_start_do(run: Recorded) -> None:
    for t_ms, total in (0, 4), (40, 5), (20, 4), (60, 0), (80, 2):  # one was overtaken
        run.slave_state(t_ms, S.ARMED, stops=total)
    report = run.report()
    assert (report.stops, report.counters["stops"]) == (3, 3)


@pytest.mark.parametrize("lost", ["7", "many", "9" * 5000])
def test_what_the_recorder_missed_is_counted(run: Recorded, lost: str) -> None:
    run.writer.add_metadata("recorder", {"lost": lost, "malformed": "2"})
    assert run.report().counters == {"recorder_malformed": 2, **({"recorder_lost": 7} if lost == "7" else {})}


def test_every_command_that_is_not_judged_is_counted_under_one_reason(run: Recorded) -> None:
    for k in range(1, 9):
        run.haptics(10 * k, k, predicted_n=None if k == 2 else 1.0, zoh_n=1.0)
    run.force(1, 1.0, answers=None)
    for k in (2, 4, 5):
        run.force(10 * k + 1, 1.0, answers=k, valid=k != 4)
    run.force(55, 1.0, answers=None)  # a stop
    run.force(71, 1.0, answers=7)
    run.force(75, 1.0, answers=None)
    run.slave_state(80, S.ARMED, counters={"refused_late": 2, "refused_sequence": 3})
    commands = run.report().commands
    assert (commands.sent, commands.scored) == (8, 2)
    counted = {"not_followed": 3, "skipped": 1, "invalid_force": 1, "not_predicted": 1}
    assert commands.reasons == counted


@pytest.mark.parametrize(
    ("found", "amber"),
    [
        ({}, False),
        ({"loop": Loops(slave=LoopFigures(ticks=10_000, missed=10))}, False),
        ({"loop": Loops(slave=LoopFigures(ticks=10_000, missed=11))}, True),
        ({"loop": Loops(master=LoopFigures(ticks=10**6, missed=61, max_us=61_000.0))}, True),
    ],
)
def test_line_is_amber_at_missed_ticks(report: RunReport, found: dict[str, object], amber: bool) -> None:
    assert (len(amber_lines(report.model_copy(update=found))) == 1) == amber


@pytest.mark.parametrize(
    ("events", "words"),
    [
        ([("rendered_energy", 75, 2.0, 0.0), ("rendered_force", 7, 9.0, 4.0)], ("75 %", "passive")),
        ([("rendered_force", 3, 9.0, 4.0), ("rendered_force", 2, -12.0, -4.0)], ("max_force_n = 4 ", "12,")),
        ([("rendered_step", 25, 2.0, 1.0)], ("25 %", "max_slew_n_s")),
        ([("rendered_late", 100, 2.0, 1.0), ("rendered_energy", 4, 2.0, 1.0)], ()),
    ],
)
def test_limit_that_changes_much_of_the_felt_force_is_named_with_its_setting(
    run: Recorded, events: list[tuple[str, int, float, float]], words: tuple[str, ...]
) -> None:
    for t_ms in range(100):
        run.haptics(t_ms, t_ms + 1, 0.5, 0.4)
    for rule, count, requested, applied in events:
        forces = {"requested": requested, "applied": applied, "unit": "N"}
        run.say(topics.MASTER_LIMIT, 5, rule=rule, count=count, **forces)
    report = run.report()
    lines = amber_lines(report)
    assert len(lines) == min(len(words), 1)
    assert all(word in line for line in lines for word in words)
    assert set(lines) <= set(report.notes)


def test_slave_that_was_never_armed_fails_the_run(run: Recorded, report: RunReport) -> None:
    require_armed(report)
    never = report.model_copy(update={"armed_share": None})
    run.say(topics.SAFETY_EVENT, 1, before=S.READY, event="engage", after=S.ENGAGING)
    run.say(topics.SAFETY_EVENT, 2, before=S.ENGAGING, reason="no valid command for 61 ms")
    run.say(topics.SAFETY_EVENT, 3, before=S.STOPPING, event="at_rest", after=S.READY)
    for unarmed, cause in (
        (never.model_copy(update={"safety_events": ()}), "no session"),
        (never.model_copy(update={"counters": {"limit_alignment": 3}}), "alignment"),
        (never, "deadman"),
        (run.report(), "watchdog"),
    ):
        with pytest.raises(RunError, match=cause):
            require_armed(unarmed)


def test_every_axis_has_a_report_and_the_loops_are_found_on_any(run: Recorded) -> None:
    rotation = RunBuilder(run.writer, "rotation")
    rotation.say(topics.MASTER_TIMING, 0)
    rotation.say(topics.SLAVE_IMPAIRMENT, 0, delays_ns=((), (1,)))
    for axis, error_n in (run, 1.0), (rotation, 2.0):
        axis.haptics(1, 1, predicted_n=error_n, zoh_n=5.0)
        axis.force(2, 0.0, answers=1)
    report = run.report()
    assert report.axis == "insertion"
    errors_n = {name: axis.prediction.rms_n for name, axis in report.axes.items()}
    assert errors_n == {"insertion": 1.0, "rotation": 2.0}
    assert report.prediction.rms_n == 1.0
    assert (report.loop.master.missed, report.loop.slave.ticks) == (2, None)
    assert report.counters["impairment_slave_inbound_dropped"] == 1


def test_ten_lines_stay_ten_whatever_the_names_hold(run: Recorded, report: RunReport) -> None:
    lines = ten_lines(report, Path("/somewhere") / ("deep" * 40))
    assert len(lines) == 10 and max(map(len, lines)) < 100
    assert "578 mN rms" in lines[2]
    assert lines[9] == DISCLAIMER
    run.writer.add_metadata("run", {"seed": "1\n2\x1b[31m", "impairment": "wan\r"})
    lines = ten_lines(run.report())
    assert len("\n".join(lines).splitlines()) == 10
    assert not any("\x1b" in line for line in lines)
