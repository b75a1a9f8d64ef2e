from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from forefeel.common.errors import RecordingError
from forefeel.common.recording.tabular import load_recording
from forefeel.common.recording.units import Mapping

GOOD = "time_s,position_m,force_n\n0,0.001,1.5\n0.5,0.002,-2\n"


def csv(folder: Path, content: str | bytes) -> Path:
    path = folder / "trial.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        GOOD.rstrip("\n"),
        GOOD + "\n  \n",
        GOOD.replace("\n", "\n\n"),
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        "\ufeff" + GOOD,
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", " , "),
        GOOD.replace("position_m", '"position_m"'),
        "note,force_n,position_m,time_s\nx,1.5,0.001,0\n,-2,0.002,0.5\n",
        '"a, ""b"""' + ",time_s,position_m,force_n\n7,0,1e-3,1.5\n7,5E-1,.002,-2.\n",
    ],
    ids=["plain", "no line end", "blank lines", "blank lines between", "CRLF", "CR", "BOM", "semicolon",
         "tab", "blanks", "quoted", "order and other columns", "quoted delimiter"],
)  # fmt: skip
def test_csv_as_the_world_writes_it(tmp_path: Path, content: str) -> None:
    recording = load_recording(csv(tmp_path, content))
    assert recording.name == "trial"
    assert recording.source == str(tmp_path / "trial.csv")
    assert recording.time_s.tolist() == [0.0, 0.5]
    assert recording.position_m.tolist() == [0.001, 0.002]
    assert recording.force_n is not None
    assert recording.force_n.tolist() == [1.5, -2.0]


def test_a_mapping_names_columns_and_units(tmp_path: Path) -> None:
    path = csv(tmp_path, "t,laser: raw,load\n0,1,500\n20,2,-250\n")
    recording = load_recording(path, Mapping(time="ms:t", position="mm : laser: raw", force="mN:load"))
    assert recording.time_s == pytest.approx([0.0, 0.020])
    assert recording.position_m == pytest.approx([0.001, 0.002])
    assert recording.force_n == pytest.approx([0.5, -0.25])
    assert load_recording(path, Mapping("ms:t", "mm:laser: raw")).force_n is None


@pytest.mark.parametrize(
    "mapping",
    [
        {"time": "min:t"}, {"position": "N:x"}, {"force": "V:load"}, {"force": "load"}, {"time": "s: "},
        {"position": ":x"},
    ],
)  # fmt: skip
def test_mapping_without_unit_or_column_is_refused(mapping: dict[str, str]) -> None:
    ((name, value),) = mapping.items()
    with pytest.raises(RecordingError, match=f"^{name} = {value!r}: "):
        Mapping(**mapping)


HEADER = "time_s,position_m,force_n\n"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", ": empty file"),
        ("\n \n", ": only blank lines"),
        ("0,1,2\n1,2,3\n", ": line 1: numbers"),
        ("time_s,x\n0,1\n", ": no column 'position_m', it has 'time_s', 'x'"),
        ("time_s,position_m,time_s\n0,1,2\n", ": 2 columns are named 'time_s'"),
        (HEADER, ": 0 sample(s)"),
        (HEADER + "0,1,2\n", ": 1 sample(s)"),
        (HEADER + "0,1,2\n1,2\n", ": line 3: 2 cell(s), expected 3"),
        (HEADER + "0,1,2\n\n1,x,3\n", ": line 4, column 'position_m': 'x', expected a number"),
        (HEADER + "0,1,2\n1,,3\n", ": line 3, column 'position_m': ''"),
        (HEADER + "0,1," + "9z" * 50 + "\n", f": line 2, column 'force_n': '{'9z' * 20}', expected"),
        (HEADER + "0,1,2\n1,2,nan\n", ": line 3, column 'force_n': nan"),
        (HEADER + "0,1,2\n1e999,1,3\n", ": line 3, column 'time_s': inf"),
        (HEADER + "0,1,2\n0.3,1,2\n0.2,1,2\n", ": line 4, column 'time_s': 0.2 after 0.3"),
        (HEADER + "0,1,2\n0.3,1,2\n0.3,1,2\n", ": line 4, column 'time_s': 0.3 after 0.3"),
        (b"time_s,position_m\n0,\xff\n", ": byte 20 is not UTF-8"),
        (HEADER + '0,"1\n2",2\n1,2,3\n', ": line 3, column 'position_m': '1\\n2'"),
        (HEADER + "0,1,2\n" + "3" * 2**18, ": line 3: field larger than field limit"),
    ],
)
def test_csv_mistake_is_one_line_with_its_place(tmp_path: Path, content: str | bytes, expected: str) -> None:
    path = csv(tmp_path, content)
    with pytest.raises(RecordingError) as caught:
        load_recording(path)
    assert str(caught.value).startswith(f"{path}{expected}")
    assert "\n" not in str(caught.value)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300, deadline=None)
@given(st.text(alphabet='01.,;-e\n\r\t" nax\ufeff', max_size=60) | st.binary(max_size=60))
def test_any_file_is_a_recording_or_one_line(tmp_path: Path, content: str | bytes) -> None:
    body = content if isinstance(content, bytes) else content.encode()
    path = csv(tmp_path, b"time_s,position_m\n" + body)
    try:
        assert len(load_recording(path)) >= 2
    except RecordingError as error:
        assert str(error).startswith(str(path))
        assert "\n" not in str(error)


def parquet(path: Path, **columns: object) -> Path:
    pyarrow = pytest.importorskip("pyarrow")
    pytest.importorskip("pyarrow.parquet").write_table(pyarrow.table(columns), path)
    return path


def test_parquet_holds_the_same_recording(tmp_path: Path) -> None:
    time_s = np.arange(500) * 1e-3
    path = parquet(
        tmp_path / "trial.parquet",
        time_s=time_s,
        position_m=np.arange(500, dtype=np.int32),
        force_n=np.linspace(-1, 1, 500, dtype=np.float32),
        note=["x"] * 500,
    )
    recording = load_recording(path)
    assert recording.name == "trial"
    np.testing.assert_array_equal(recording.time_s, time_s)
    np.testing.assert_array_equal(recording.position_m, np.arange(500.0))
    np.testing.assert_array_equal(recording.force_n, np.linspace(-1, 1, 500, dtype=np.float32).astype(float))
    mapped = load_recording(path, Mapping("ms:time_s", "um:position_m", "gf:force_n"))
    assert mapped.duration_s == pytest.approx(0.499e-3)
    assert mapped.position_m[-1] == pytest.approx(499e-6)


def test_what_is_no_parquet_file(tmp_path: Path) -> None:
    path = parquet(tmp_path / "trial.parquet", time_s=[0, 1], position_m=[0, 1])
    whole = path.read_bytes()
    for content in (b"no parquet at all", whole[: len(whole) // 2], whole[:-200] + bytes(192) + whole[-8:]):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=r"^[^\n]*expected a Parquet file$"):
            load_recording(path)
    path.write_bytes(b"")
    with pytest.raises(RecordingError, match=r": empty file, expected a recording$"):
        load_recording(path)
