"""One recording as people have it: by the writers of other programs."""

import csv
import io
import zipfile
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from mcap.writer import Writer
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

T_S = np.arange(400) / 200.0
X_M = 0.010 + 0.008 * np.sin(5.0 * T_S) + 0.002 * np.sin(13.0 * T_S)
F_N = 12.0 * X_M + 0.5 * np.gradient(X_M, T_S)
START = datetime(2026, 3, 1, 10, tzinfo=UTC)
START_NS = int(START.timestamp()) * 10**9
_SI = "time_s,position_m,force_n"
_ROWS = list(zip(T_S.tolist(), X_M.tolist(), F_N.tolist(), strict=True))
_TEXTS = [list(map(repr, row)) for row in _ROWS]


def text(header: str, delimiter: str = ",", scale: float = 1.0, end: str = "\n") -> str:
    """A header, and rows of time, position times `scale`, force."""
    rows = "".join(delimiter.join((f"{t:.4f}", f"{scale * x:.7f}", f"{f:.7f}")) + end for t, x, f in _ROWS)
    return f"{header}{end if header else ''}{rows}"


def stamped(header: str, stamp: Callable[[float], str]) -> str:
    return header + "\n" + "".join(f"{stamp(t)},{1e3 * x:.5f},{f:.7f}\n" for t, x, f in _ROWS)


def german() -> bytes:
    body = text("", ";", 1e3, "\r\n").replace(".", ",")
    return b"\xef\xbb\xbf" + f"Zeit [s];Weg [mm];Kraft [N]\r\n{body}".encode()


def quoted() -> str:
    written = io.StringIO()
    rows = csv.writer(written, quoting=csv.QUOTE_ALL)
    rows.writerows([("Time", "Extension", "Load"), ("(s)", "(mm)", "(N)")])
    rows.writerows((t, 1e3 * x, f) for t, x, f in _ROWS)
    return written.getvalue()


def clock(t: float) -> str:
    return (START + timedelta(seconds=t)).strftime("%H:%M:%S.%f")


def epoch_ms(t: float) -> str:
    return str(START_NS // 10**6 + round(1e3 * t))


def iso(t: float) -> str:
    return (START + timedelta(seconds=t)).isoformat()


def remarked() -> bytes:
    body = "".join(f"{t:.4f};{1e3 * x:.5f};{f:.7f};{'Führung' * (t == 0)}\n" for t, x, f in _ROWS)
    return f"Zeit_s;Weg_mm;Kraft_N;Bemerkung\n{body}".encode("latin-1")


CLEAR: dict[str, tuple[str, str | bytes]] = {
    "plain": ("csv", text(_SI)),
    "german_excel": ("csv", german()),
    "semicolons": ("csv", text(_SI.replace(",", ";"), ";")),
    "bom_crlf": ("csv", b"\xef\xbb\xbf" + text(_SI, end="\r\n").encode()),
    "row_of_units": ("csv", text("time,position,force\ns,mm,N", scale=1e3)),
    "units_in_header": ("csv", text("Time (s),Position [mm],Force (N)", scale=1e3)),
    "capitals_blanks": ("csv", text("Time_s, Position_m, Force_N", ", ")),
    "iso_stamps": ("csv", stamped("timestamp,position_mm,force_n", iso)),
    "clock": ("csv", stamped("time,position_mm,force_n", clock)),
    "epoch_ms": ("csv", stamped("time_ms,position_mm,force_n", epoch_ms)),
    "comments": ("csv", f"# rig 7\n# {_SI}\n" + text("")),
    "tsv": ("tsv", text(_SI.replace(",", "\t"), "\t")),
    "txt": ("txt", text(_SI.replace(",", "\t"), "\t")),
    "blanks": ("dat", text(_SI.replace(",", " "), "   ")),
    "savetxt": ("txt", text("# " + _SI.replace(",", " "), " ")),
    "latin_1": ("csv", remarked()),
    "quoted": ("csv", quoted()),
    "title": ("csv", "Experiment 12\nDate,2026-03-01\n\n" + text(_SI)),
    "utf_16": ("txt", text("Time (s)\tStroke (mm)\tForce (N)", "\t", 1e3).encode("utf-16")),
    "trailing_delimiter": ("csv", text(_SI + ",", end=",\n").replace(",,\n", ",\n", 1)),
}
"""Files of text that say what they hold: suffix and content."""


def spreadsheet(path: Path, title: Sequence[str] = ("Rig 7, run 3",)) -> None:
    book = openpyxl.Workbook()
    book.active.append(list(title))
    book.active.append(["Time (s)", "Position (mm)", "Force (N)"])
    for t, x, f in _ROWS:
        book.active.append([t, 1e3 * x, f])
    book.create_sheet("Setup", 0).append(["Load cell (N)", 50, 2.0])
    book.save(path)


def matlab(path: Path) -> None:
    cell = np.array([{"gain": 2.0}, np.arange(3.0)], dtype=object)
    scipy.io.savemat(path, {"rec": {"t_s": T_S, "x_mm": 1e3 * X_M, "F_N": F_N, "note": "run 3", "rig": cell}})


def structures(path: Path) -> None:
    trial = np.array([(T_S, 1e3 * X_M, F_N)] * 2, dtype=[(name, object) for name in ("t_s", "pos_mm", "F_N")])
    scipy.io.savemat(path, {"trial": trial})


def numpy_archive(path: Path) -> None:
    np.savez(path, t_s=T_S, x_mm=1e3 * X_M, F_N=F_N, rig=np.array({"number": 7}, dtype=object))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("readme.txt", "run 3")


def matlab_73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("time_s", T_S), ("position_mm", 1e3 * X_M), ("force_N", F_N)):
            file.create_dataset(name, data=values[None, :], compression="gzip")


def tdms(path: Path) -> None:
    with TdmsWriter(path) as file:
        more = {"wf_increment": 0.005, "wf_samples": len(T_S)}
        file.write_segment([
            ChannelObject("rig", "Position", 1e3 * X_M, {"unit_string": "mm", **more}),
            ChannelObject("rig", "Force", F_N, {"unit_string": "N", **more}),
        ])  # fmt: skip


def parquet(kind: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        stamps = pa.array((T_S * 1e9).round().astype(np.int64) + START_NS, pa.timestamp("ns"))
        columns: dict[str, Any] = {
            "float32": {"time_s": T_S, "position_m": np.float32(X_M), "force_n": np.float32(F_N)},
            "stamps": {"time": stamps, "position_mm": 1e3 * X_M, "force_n": F_N},
            "text": {name: [row[i] for row in _TEXTS] for i, name in enumerate(_SI.split(","))},
        }[kind]
        pq.write_table(pa.table(columns), path)

    return write


def _messages(store: Typestore, **header: int) -> Iterator[tuple[int, str, Any]]:
    made = store.types
    for t, x, f in _ROWS:
        ns = START_NS + round(t * 1e9)
        stamp = made["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        head = made["std_msgs/msg/Header"](stamp=stamp, frame_id="", **header)
        vector = made["geometry_msgs/msg/Vector3"]
        along, none = vector(x=0.0, y=0.0, z=f), vector(x=0.0, y=0.0, z=0.0)
        wrench = made["geometry_msgs/msg/Wrench"](force=along, torque=none)
        yield ns, "/ft", made["geometry_msgs/msg/WrenchStamped"](header=head, wrench=wrench)
        joint = ["slide"], np.array([x]), np.array([]), np.array([])
        yield ns, "/joint_states", made["sensor_msgs/msg/JointState"](head, *joint)


def bag(path: Path) -> None:
    store, connections = get_typestore(Stores.ROS1_NOETIC), dict[str, Any]()
    with BagWriter(path) as writer:
        for ns, topic, message in _messages(store, seq=0):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], ns, store.serialize_ros1(message, kind))


def mcap(path: Path) -> None:
    store, channels = get_typestore(Stores.ROS2_HUMBLE), dict[str, int]()
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        for ns, topic, message in _messages(store):
            kind = message.__msgtype__
            if topic not in channels:
                definition, _ = store.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", definition.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], ns, bytes(store.serialize_cdr(message, kind)), ns)
        writer.finish()  # type: ignore[no-untyped-call]


WRITTEN: dict[str, Callable[[Path], None]] = {
    "title.xlsx": spreadsheet,
    "v5.mat": matlab,
    "structures.mat": structures,
    "arrays.npz": numpy_archive,
    "v73.mat": matlab_73,
    "waveform.tdms": tdms,
    "float32.parquet": parquet("float32"),
    "stamps.parquet": parquet("stamps"),
    "text.parquet": parquet("text"),
    "ros.bag": bag,
    "ros2.mcap": mcap,
}
"""Files of other programs that say what they hold."""
