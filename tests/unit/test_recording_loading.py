"""Recordings as people have them: taken for what they are, or refused with what to add."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from forefeel.common.errors import RecordingError, UnclearError
from forefeel.common.recording.loading import load, load_recording
from forefeel.common.recording.recording import Array, Recording
from forefeel.common.recording.units import Mapping
from tests.unit import people
from tests.unit.people import F_N, T_S, X_M, text

_SI = "time_s,position_m,force_n"
X_STILL = X_M[0] + 0.1 * X_M


def table(header: str, *columns: NDArray[Any]) -> str:
    """Rows of the columns; what is NaN is left empty."""
    rows = (",".join("" if np.isnan(v) else f"{v:.10g}" for v in row) for row in zip(*columns, strict=True))
    return "\n".join([header, *rows]) + "\n"


def written(folder: Path, content: str | bytes, suffix: str = "csv") -> Path:
    path = folder / f"trial.{suffix}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def assert_whole(recording: Recording) -> None:
    assert len(recording) == len(T_S)
    np.testing.assert_allclose(recording.time_s - recording.time_s[0], T_S, atol=1e-6)
    np.testing.assert_allclose(recording.position_m, X_M, atol=1e-7)
    assert recording.force_n is not None
    np.testing.assert_allclose(recording.force_n, F_N, atol=1e-6)


@pytest.mark.parametrize("name", people.CLEAR)
def test_text_that_says_what_it_holds_is_read(tmp_path: Path, name: str) -> None:
    suffix, content = people.CLEAR[name]
    recording = load_recording(written(tmp_path, content, suffix), force=True)
    assert_whole(recording)
    assert set(recording.columns) == {"time", "position", "force"}
    assert recording.notes == ()


def test_a_capital_letter_is_mega(tmp_path: Path) -> None:
    force_n = load_recording(written(tmp_path, text("time_s,position_m,Force (MN)"))).force_n
    assert force_n is not None
    np.testing.assert_allclose(force_n, 1e6 * F_N, atol=0.1)


@pytest.mark.parametrize("name", people.WRITTEN)
def test_files_of_other_programs_are_read(tmp_path: Path, name: str) -> None:
    people.WRITTEN[name](tmp_path / name)
    recording = load_recording(tmp_path / name, force=True)
    assert_whole(recording)
    assert ("sheet 'Sheet'" in recording.taken) == (name == "title.xlsx")


@pytest.mark.parametrize(
    ("content", "columns"),
    [
        (text("Time,Displacement,Load", scale=1e3), ("s:Time", "mm:Displacement", "N:Load")),
        (text("", scale=1e3), ("s:1", "mm:2", "N:3")),
        (text("time_s,motor,a b", scale=1e3), (None, "mm:motor", "N:a b")),
        (table("t,mdq,mq,mtorque", T_S, np.gradient(X_M, T_S), X_M, F_N), ("s:t", "rad:mq", "Nm:mtorque")),
        (table("t,tcp_x,tcp_z,Fx,Fz", T_S, X_STILL, X_M, 0.1 * F_N, F_N), ("s:t", "m:tcp_z", "N:Fz")),
        (table("t_s,a.pos,b.pos,b.force (N)", T_S, X_STILL, X_M, F_N), (None, "m:b.pos", None)),
        (
            table("t,s,Course,t,s,Course\nsec,N,mm,sec,N,mm", T_S, F_N, 1e3 * X_M, T_S, 2 * F_N, 1e3 * X_M),
            (None, None, "N:s 2"),
        ),
        (text("X_Value,LVDT (mm),Force (N)", scale=1e3), ("s:X_Value", "mm:LVDT (mm)", None)),
        (text("time_s,position_a_m,force_n\n"), (None, None, None)),
    ],
)
def test_what_is_not_sure_is_asked(tmp_path: Path, content: str, columns: tuple[str | None, ...]) -> None:
    path = written(tmp_path, content)
    expected = zip(("time", "position", "force"), columns, strict=True)
    asked: dict[str, Any] = {quantity: column for quantity, column in expected if column}
    if asked:
        with pytest.raises(UnclearError) as caught:
            load_recording(path, force=True)
        assert caught.value.columns == asked
    assert_whole(load_recording(path, Mapping(**asked) if asked else None, force=True))


@pytest.mark.parametrize(
    "header",
    [
        "time_s,position_m,rs_raw_ohm", "time_s,position_m,Dev1/ai0 (V)", "time_s,position_m,tag_id",
        "time_s,position_m,hx711_raw", "time_s,position_m,load_pct", "time_s,position_m,std_force_n",
        "time_s,position_m,force_cmd (N)", "Index,position_m,force_n", "time_s,vX,force_n",
        "time_s,pose_4,force_n", "time_s,Strain (%),force_n", "time_s,observation.state[0],force_n",
        "time_s,position_counts,force_n", "time_s,Vibration (g),force_n",
        "time_s,tau_Nm,force_n", "time_s,tau_nm,force_n",
    ],
)  # fmt: skip
def test_no_column_is_offered_that_states_another_quantity(tmp_path: Path, header: str) -> None:
    with pytest.raises(RecordingError, match=r": no (time|position|force): no column is named so") as caught:
        load_recording(written(tmp_path, text(header)), force=True)
    assert not isinstance(caught.value, UnclearError)


ROWS = text(_SI).splitlines(keepends=True)
HUNDREDTHS = np.floor(100.0 * T_S + 1e-6) / 100.0
HOLES = {10: "0.0450,,1.0\n", 20: "0.0950,0.01,NaN\n", 30: "0.1450, ,\n"}
FIFTIETHS = np.floor(50.0 * T_S + 1e-6) / 50.0
SWAPPED = np.concatenate([np.arange(201), [210], np.arange(202, 210), [201], np.arange(211, 400)])
MISSING = "".join(HOLES.get(number, row) for number, row in enumerate(ROWS))


def test_rows_without_time_need_their_rate(tmp_path: Path) -> None:
    counted = table("No,position_m,force_n", np.arange(len(T_S)), X_M, F_N)
    recording = load_recording(written(tmp_path, counted), Mapping(rate_hz=200.0), force=True)
    assert_whole(recording)
    assert "rows at 200 Hz" in recording.taken
    stamped = written(tmp_path, table("t [s],position_m,force_n", T_S, X_M, F_N))
    assert "rows at 200 Hz, not by 't [s]'" in load_recording(stamped, Mapping(rate_hz=200.0)).taken
    for mapping in ({"rate_hz": 0.0}, {"rate_hz": 50.0, "time": "s:No"}):
        with pytest.raises(RecordingError, match="expected a rate in Hz"):
            Mapping(**mapping)


@pytest.mark.parametrize(
    ("content", "count", "note"),
    [
        (MISSING, 397, "3 of 400 rows dropped for a missing number"),
        (MISSING.replace(",,1.0", ",null,1.0"), 397, "3 of 400 rows dropped for a missing number"),
        (ROWS[0] + "".join(2 * row for row in ROWS[1:]), 400, "400 of 800 rows dropped as duplicates"),
        ("".join(ROWS + ROWS[1:]), 800, "the time goes back (1 x): taken as 2 runs"),
        ("".join([*ROWS[:10], *ROWS[12:9:-1], *ROWS[13:]]), 400, "2 rows put in their order"),
        (table(_SI, *(column[SWAPPED] for column in (FIFTIETHS, X_M, F_N))), 400, "put in their order"),
        (text(_SI)[:-15], 399, "the last line, which is cut off"),
        (table("micros,position_m,force_n", (1e6 * T_S + 2.0**32 - 1e6) % 2.0**32, X_M, F_N), 400, "2^32 us"),
        (table("t_ms,position_m,force_n", (1e3 * FIFTIETHS + 64536.0) % 2.0**16, X_M, F_N), 400, "2^16"),
        (table("t_s,position_m,force_n", (T_S + 4294.0) % 4294.967296, X_M, F_N), 400, "2^32 us"),
        (
            table(_SI, T_S, X_M, np.where(np.arange(400) % 150 == 149, 8388.607, F_N)),
            398,
            "2 x 8388.607 (2^23 - 1) in force_n, full scale",
        ),
        (table(_SI, HUNDREDTHS, X_M, F_N), 400, "lost their digits below 0.01 s"),
        (table("time_s,position_m,F (N),F (N)", T_S, X_M, F_N, F_N), 400, "F (N) 4 equals F (N) 3"),
    ],
    ids=[
        "missing",
        "words",
        "doubled",
        "two_runs",
        "misplaced",
        "misplaced_rounded",
        "cut",
        "us",
        "ms_rounded",
        "s",
        "scale",
        "digits",
        "equal",
    ],
)
def test_what_is_dropped_or_moved_is_said(tmp_path: Path, content: str, count: int, note: str) -> None:
    recording = load_recording(written(tmp_path, content))
    assert len(recording) == count
    assert any(note in each for each in recording.notes)
    assert len(recording.segments()) == (2 if "2 runs" in note else 1)
    if count == len(T_S):  # rounded stamps are spread evenly
        np.testing.assert_allclose(recording.time_s - recording.time_s[0], T_S, atol=1e-7)


def every(step: int, values: NDArray[np.float64], first: int = 0) -> NDArray[np.float64]:
    return np.where(np.arange(len(values)) % step == first, values, np.nan)


@pytest.mark.parametrize(
    ("position", "force", "rate_hz", "note"),
    [
        (every(4, X_M), F_N, 200.0, "position_m, of 50 Hz, is interpolated at the 200 Hz of force_n"),
        (every(2, X_M), every(2, F_N, 1), 100.0, "position_m, of 100 Hz, is interpolated at the 100 Hz"),
        (X_M, every(4, F_N), 50.0, "force_n, of 50 Hz, is the slower"),
        (X_M[np.arange(400) // 4 * 4], F_N, 200.0, "position_m is held: it changes at 50 Hz"),
        (X_M, F_N[np.arange(400) // 4 * 4], 50.0, "force_n is held: it changes at 50 Hz"),
    ],
    ids=["slow_position", "apart", "slow_force", "held_position", "held_force"],
)
def test_columns_of_two_rates_are_used_at_the_stamps_of_the_force(
    tmp_path: Path, position: NDArray[np.float64], force: NDArray[np.float64], rate_hz: float, note: str
) -> None:
    recording = load_recording(written(tmp_path, table(_SI, T_S, position, force)), force=True)
    assert recording.rate_hz == pytest.approx(rate_hz)
    assert note in recording.taken
    np.testing.assert_allclose(recording.position_m, np.interp(recording.time_s, T_S, X_M), atol=3e-6)
    assert recording.force_n is not None
    np.testing.assert_allclose(recording.force_n, np.interp(recording.time_s, T_S, F_N), atol=1e-6)


WITHOUT_DIGITS = table("stamp,position_m,force_n", 1.7e9 + 128.0 * (T_S > 1.0), X_M, F_N)


def test_a_slow_column_is_not_interpolated_over_a_gap(tmp_path: Path) -> None:
    position = every(4, X_M)
    position[101:199] = np.nan
    recording = load_recording(written(tmp_path, table(_SI, T_S, position, F_N)))
    assert not np.any((recording.time_s > T_S[100]) & (recording.time_s < T_S[200]))
    assert len(recording) > 290


def test_a_coarse_encoder_and_one_at_rest_are_not_held(tmp_path: Path) -> None:
    for x in (np.round(X_M, 3), np.where(T_S < 1.0, X_M[200], X_M)):
        assert load_recording(written(tmp_path, table(_SI, T_S, x, F_N))).notes == ()


def test_a_cell_that_is_tared_again_is_told_and_has_one_zero(tmp_path: Path) -> None:
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(T_S))
    tared = F_N + noise + 0.6 * (T_S > 0.3) - 0.5 * (T_S > 1.6)
    recording = load_recording(written(tmp_path, table(_SI, T_S, X_M, tared)))
    for step in ("0.6 N at 0.305 s", "-0.5 N at 1.605 s"):
        assert any(note.startswith(f"a step of {step}: tared again?") for note in recording.notes)
    assert recording.force_n is not None
    np.testing.assert_allclose(recording.force_n, F_N, atol=0.01)
    stiffer = F_N + noise + (T_S > 1.2) * 30.0 * X_M  # what a change of the stiffness makes is none
    assert load_recording(written(tmp_path, table(_SI, T_S, X_M, stiffer))).notes == ()


def test_episodes_of_lerobot_are_runs_with_their_names(tmp_path: Path) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "data" / "chunk-000").mkdir(parents=True)
    info = {"features": {"observation.state": {"names": {"motors": ["slide.pos", "slide.force"]}}}}
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    for episode in (0, 1):
        columns = {"timestamp": T_S[:50], "episode_index": np.full(50, episode)}
        state = pa.array(np.column_stack([1e3 * X_M, F_N])[:50].tolist())
        path = tmp_path / "data" / "chunk-000" / f"episode_{episode:06d}.parquet"
        pq.write_table(pa.table({"observation.state": state, **columns}), path)
    with pytest.raises(UnclearError) as caught:
        load_recording(tmp_path, force=True)
    names = {"position": "mm:observation.state.slide.pos", "force": "N:observation.state.slide.force"}
    assert caught.value.columns == names
    recording = load_recording(tmp_path, Mapping(**caught.value.columns), force=True)
    assert (len(recording), len(recording.segments())) == (100, 2)
    assert "2 episodes" in recording.taken


def test_a_mapping_names_columns_and_units(tmp_path: Path) -> None:
    path = written(tmp_path, "t,laser: raw,load\n0,1,500\n20,2,-250\n40,4,0\n")
    recording = load_recording(path, Mapping(time="ms:t", position="mm : laser: raw", force="mN:load"))
    assert recording.time_s == pytest.approx([0.0, 0.020, 0.040])
    assert recording.position_m == pytest.approx([0.001, 0.002, 0.004])
    assert recording.force_n == pytest.approx([0.5, -0.25, 0.0])


@pytest.mark.parametrize(
    "mapping", [{"time": "h:t"}, {"position": "N:x"}, {"force": "load"}, {"position": ":x"}]
)
def test_mapping_without_unit_or_column_is_refused(mapping: dict[str, Any]) -> None:
    ((name, value),) = mapping.items()
    with pytest.raises(RecordingError, match=f"^{name} = {value!r}: "):
        Mapping(**mapping)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", ": empty file"),
        ("\n \n", ": only blank lines"),
        (_SI, ": no row of numbers"),
        (f"{_SI}\n0,1,2\n", ": 1 sample(s)"),
        (f"{_SI}\n0,1,2\n1,2\n2,3,4\n", ": line 3: 2 cell(s), expected 3"),
        (f"{_SI}\n0,1,2\n1,x,3\n", ": line 3, column 'position_m': 'x', expected a number"),
        ("time_s,x_m,x_mm,force_n\n0,1,1,2\n1,2,2,3\n", ": 'x_m', 'x_mm' may each be the position"),
        (WITHOUT_DIGITS, ": no unit of 'stamp' is stated; with time = s:stamp: "),  # a proposal is tried
    ],
)
def test_a_table_that_can_not_be_used_is_one_line(tmp_path: Path, content: str, expected: str) -> None:
    path = written(tmp_path, content)
    with pytest.raises(RecordingError) as caught:
        load_recording(path, force=True)
    assert str(caught.value).startswith(f"{path}{expected}")
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, UnclearError) == ("may each be" in expected)


def test_other_files_that_can_not_be_used_are_one_short_line(tmp_path: Path) -> None:
    people.spreadsheet(tmp_path / "whole.xlsx")
    (tmp_path / "cut.xlsx").write_bytes((tmp_path / "whole.xlsx").read_bytes()[:2000])
    texts = ["0", "\x1b[31m" + 10**6 * "x"]
    pq.write_table(pa.table({"time_s": texts, "position_m": texts}), tmp_path / "raw.parquet")
    rubbish = [
        written(tmp_path, b"rubbish" * 100, each) for each in ("mcap", "mat", "tdms", "parquet", "bag")
    ]
    others = (tmp_path, *(tmp_path / name for name in ("none.csv", "cut.xlsx", "raw.parquet")))
    for path in (*rubbish, *others):
        with pytest.raises(RecordingError) as caught:
            load_recording(path)
        assert str(caught.value).startswith(str(path))
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 1000


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300, deadline=None)
@given(st.text(alphabet='01.,;-e\n\r\t" nax\ufeff', max_size=60).map(str.encode) | st.binary(max_size=60))
def test_any_file_is_a_recording_or_one_line(tmp_path: Path, content: bytes) -> None:
    path = written(tmp_path, b"time_s,position_m\n" + content)
    try:
        assert len(load_recording(path)) >= 2
    except RecordingError as error:
        assert str(error).startswith(str(path))
        assert str(error).isprintable()


def moved(time_s: Array) -> Array:
    return np.asarray(0.01 * np.sin(2.0 * np.pi * 0.7 * time_s))


def raw_storage(file: h5py.File, name: str, other: Path) -> None:
    file.create_dataset(name, (len(T_S),), "f8", external=[(str(other), 0, 8 * len(T_S))])


def virtual(file: h5py.File, name: str, other: Path) -> None:
    layout = h5py.VirtualLayout(T_S.shape, "f8")
    layout[:] = h5py.VirtualSource(str(other), name, T_S.shape)
    file.create_virtual_dataset(name, layout)


def link(file: h5py.File, name: str, other: Path) -> None:
    file[name] = h5py.ExternalLink(str(other), name)


@pytest.mark.parametrize("kind", [raw_storage, virtual, link])
def test_hdf5_reads_no_other_file(tmp_path: Path, kind: Callable[[h5py.File, str, Path], None]) -> None:
    other, path = tmp_path / "other.h5", tmp_path / "run.h5"
    with h5py.File(other, "w") as foreign, h5py.File(path, "w") as file:
        for name in ("time_s", "position_m"):
            foreign[name] = T_S
            kind(file, name, other)
    with pytest.raises(RecordingError):
        load_recording(path)


@pytest.mark.parametrize(("taken_hz", "row_hz"), [(60.0, 200.0), (40.0, 100.0), (30.0, 250.0)])
def test_a_position_held_at_an_uneven_ratio_counts_when_it_was_taken(taken_hz: float, row_hz: float) -> None:
    """By the rows in which it is new it would be late by up to a row, now more, now less."""
    t = np.arange(0.0, 20.0, 1.0 / row_hz)
    held = moved(np.floor(t * taken_hz + 1e-9) / taken_hz)
    found = load({"time_s": t, "position_m": held, "force_N": np.cos(t)})
    inside = slice(20, -20)
    np.testing.assert_allclose(found.position_m[inside], moved(found.time_s)[inside], atol=2e-6)
    assert np.std(held - moved(t)) > 2e-4


def test_a_position_held_across_gaps_is_held() -> None:
    """Gaps of whole rows shift the rhythm against the stamps; in rows it stays."""
    rows = np.arange(4000)
    t = rows / 200.0 + 0.0137 * (rows // 500)
    found = load({"time_s": t, "position_m": moved(t[rows // 5 * 5]), "force_N": np.cos(t)})
    assert any("is held: it changes at 40 Hz" in note for note in found.notes)


def test_names_without_an_axis_come_before_those_of_axes() -> None:
    t = np.arange(100) * 0.01
    table = {"time_s": t, "position_mm": np.sin(t), "y_mm": t, "Load (N)": t, "force_y_N": t * t}
    assert load(table).columns == {"time": "s:time_s", "position": "mm:position_mm", "force": "N:Load (N)"}


def test_row_without_a_date_is_dropped() -> None:
    stamps = (1e9 * T_S).astype("datetime64[ns]")
    stamps[200] = np.datetime64("NaT")
    assert len(load({"time": stamps, "position_m": X_M, "force_n": F_N})) == len(T_S) - 1


def test_message_without_a_force_costs_its_row_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = list(zip(T_S, X_M, np.where(np.arange(len(T_S)) == 200, np.nan, F_N), strict=True))
    monkeypatch.setattr(people, "_ROWS", rows)
    people.bag(tmp_path / "ros.bag")
    assert len(load_recording(tmp_path / "ros.bag", force=True)) == len(T_S) - 1
