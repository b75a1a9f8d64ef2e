from pathlib import Path

import pytest

from forefeel.common.errors import RecordingError, RunError
from forefeel.common.messages import MOST_FORCE_N
from forefeel.common.recording.mcap_writer import RunWriter
from forefeel.common.topics import CALIBRATION, HAPTICS, MASTER_TIMING, PARAMETERS, SAFETY_EVENT
from forefeel.files import write_whole
from forefeel.loopback.outcome import amber_lines
from forefeel.report.page import write_report
from tests.unit.page_checks import check_page
from tests.unit.report_run import VESSEL, RunBuilder, S, recorded, write_known_run

HOSTILE = '<script>alert("1")</script>'
TITLES = "In the vessel", "Force", "Identified parameters"


def test_page_stands_alone_draws_each_figure_once_and_shows_hostile_texts_as_text(tmp_path: Path) -> None:
    written = tmp_path / "new" / "folder"
    write_known_run(tmp_path / "recording.mcap", reason=HOSTILE, seed=HOSTILE)
    write_report(tmp_path / "recording.mcap", written)
    assert sorted(path.name for path in written.iterdir()) == ["report.html", "report.json"]
    page = (written / "report.html").read_text()
    assert len(page) < 3_000_000
    assert "<script>" not in page
    assert page.count("&lt;script&gt;alert(") >= 2
    check_page(page, figures=len(TITLES))
    for title in TITLES:
        assert page.count(f"<h3>{title}</h3>") == 1


def test_an_empty_run_has_a_page(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "run.mcap"):
        pass
    write_report(tmp_path / "run.mcap", tmp_path)
    assert "<canvas" not in (tmp_path / "report.html").read_text()


def test_file_name_that_is_no_utf_8_has_a_question_mark_for_its_byte(tmp_path: Path) -> None:
    path = tmp_path / "run\udcfc.mcap"
    RunWriter(path).close()
    assert write_report(path, tmp_path).recording == "run?.mcap"
    write_whole(tmp_path / "diagnosis.json", "run\udcfc")
    assert (tmp_path / "diagnosis.json").read_text() == "run?"


@pytest.mark.parametrize("parameters", [{}, {"values": ()}])
def test_one_message_of_each_and_a_model_that_ran_away_have_a_page(
    tmp_path: Path, parameters: dict[str, tuple[float, ...]]
) -> None:
    with recorded(tmp_path / "run.mcap") as run:
        run.haptics(0, 1, predicted_n=MOST_FORCE_N, zoh_n=0.0, answered=1, delay_s=0.0)
        run.force(0, 1.0, answers=1)
        run.slave_state(0, S.ARMED)
        run.say(PARAMETERS, 0, **parameters)
        run.say(MASTER_TIMING, 0)
    report = write_report(tmp_path / "run.mcap", tmp_path)
    assert report.prediction.rms_n == pytest.approx(MOST_FORCE_N, rel=1e-3)
    assert "0 ms ahead" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(("unknown", "figures"), [("delay_s", 1), ("force_age_s", 1), ("snapshot", 2)])
def test_without_a_delay_or_an_age_of_a_force_the_vessel_is_not_drawn(
    tmp_path: Path, unknown: str, figures: int
) -> None:
    known = {"predicted_n": 1.0, "zoh_n": 2.0, "rendered_n": 1.0, "command_position_m": 0.001}
    times = {"delay_s": 0.02, "force_age_s": 0.01, "answered_sequence": 1, "snapshot": 1}
    with RunWriter(tmp_path / "run.mcap") as writer:
        writer.add_metadata("run", {"vessel": VESSEL})
        run = RunBuilder(writer)
        run.say(HAPTICS, 0, sequence=1, **known | times | {unknown: None})
        run.force(0, 1.5, answers=1)
    write_report(tmp_path / "run.mcap", tmp_path)
    check_page((tmp_path / "report.html").read_text(), figures)


def test_fault_after_a_hundred_transitions_is_a_note_though_no_line_of_the_table(tmp_path: Path) -> None:
    with recorded(tmp_path / "run.mcap") as run:
        for t_ms in range(0, 120, 2):
            run.say(SAFETY_EVENT, t_ms, before=S.READY, event="engage", after=S.ENGAGING)
            run.say(SAFETY_EVENT, t_ms + 1, before=S.ENGAGING, event="release", after=S.READY)
        run.say(SAFETY_EVENT, 2500, before=S.READY, event="fault", after=S.FAULT, reason="load cell is blind")
    report = write_report(tmp_path / "run.mcap", tmp_path)
    page = (tmp_path / "report.html").read_text()
    (fault,) = amber_lines(report)
    assert "2.5 s" in fault and fault in report.notes
    assert (page.count("<td>engage</td>"), page.count("load cell is blind")) == (50, 1)


def test_every_calibration_is_one_line_however_often_it_was_said(tmp_path: Path) -> None:
    named = {"slot": "load_cell", "driver": "bota_serial", "serial": "<SN-7>", "date": "2026-03-01"}
    with recorded(tmp_path / "run.mcap") as run:
        run.slave_state(0, S.READY)
        for t_ms in range(0, 9000, 2000):
            run.say(CALIBRATION, t_ms, **named, zero=-0.25, gain_n=1.02 if t_ms < 5000 else 1.5)
    report = write_report(tmp_path / "run.mcap", tmp_path)
    assert [found["gain_n"] for found in report.calibrations] == [1.02, 1.5]
    assert (tmp_path / "report.html").read_text().count("&lt;SN-7&gt;") == 2


def test_two_axes_of_a_killed_recorder_have_a_page(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "whole.mcap") as writer:
        for axis in "insertion", "rotation":
            run = RunBuilder(writer, axis)
            for k in range(1, 20):
                run.haptics(k, k, predicted_n=1.0, zoh_n=2.0)
                run.force(k, 0.0, answers=k)
        writer.flush()
        (tmp_path / "run.mcap").write_bytes((tmp_path / "whole.mcap").read_bytes())
    report = write_report(tmp_path / "run.mcap", tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert report.truncated
    assert page.count("The recorder was killed") == 2
    assert [page.count(f"<h2>Axis {axis}</h2>") for axis in ("insertion", "rotation")] == [1, 1]
    assert page.count("<h3>Force</h3>") == 2


def test_what_can_not_be_read_or_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"none\.mcap"):
        write_report(tmp_path / "none.mcap", tmp_path)
    with RunWriter(tmp_path / "run.mcap"):
        pass
    (tmp_path / "report.html").mkdir()
    with pytest.raises(RunError, match=r"report\.html: .*the report is not written"):
        write_report(tmp_path / "run.mcap", tmp_path)
    assert not list(tmp_path.glob(".*"))
