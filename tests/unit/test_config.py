import tracemalloc
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from forefeel.common.config import Settings, checked, deep_merge, dump_yaml, load_settings
from forefeel.common.errors import ConfigurationError
from forefeel.common.settings import (
    AxisLimits,
    ExistingFile,
    Segment,
    differences,
    settings_hash,
    shared_text,
)
from forefeel.common.yaml_file import load_yaml
from forefeel.master.settings import MasterSettings
from forefeel.slave.settings import SlaveSettings

DEPLOY = Path(__file__).parents[2] / "deploy" / "config"


class Drive(Settings):
    kind: Literal["drive"] = "drive"
    speed_m_s: Annotated[float, Field(gt=0, le=1)] = 0.1


class Brake(Settings):
    kind: Literal["brake"]
    force_n: float


class Machine(Settings):
    name: Segment
    count: Annotated[int, Field(ge=0)] = 0
    ratio: float = 1e-3
    span_m: tuple[float, float] = (0.0, 1.0)
    parts: tuple[Annotated[Drive | Brake, Field(discriminator="kind")], ...] = ()
    notes: ExistingFile | None = None


def written(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "machine.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def mistake(tmp_path: Path, text: str | bytes) -> str:
    """The one line of the error, without the folder."""
    with pytest.raises(ConfigurationError) as caught:
        load_settings(Machine, written(tmp_path, text))
    line = str(caught.value)
    assert len(line.splitlines()) == 1
    return line.replace(f"{tmp_path}/", "")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name: a\nspeed: 1\n", "2: speed: unknown key"),
        ("name: a\nratioo: 2\n", "2: ratioo: unknown key, expected ratio"),
        ("count: 1\n", "1: name: missing"),
        ("name: a\ncount: -1\n", "2: count = -1: "),
        ("name: a\n\ncount: many\n", "3: count = 'many': "),
        ("name: a\nratio: .nan\n", "2: ratio = nan: "),
        ("name: a\nratio: [1]\n", "2: ratio = a list: "),
        ('name: a\nratio: "1.0"\n', "2: ratio = '1.0': expected a number"),
        ("name: a\nspan_m: [0, '1e3']\n", "2: span_m = [0, '1e3']: expected a number"),
        ("name: a\nratio: on\n", "2: ratio = True: expected no truth value"),
        ("name: a\nspan_m: [no, 1]\n", "2: span_m = [False, 1]: expected no truth value"),
        ("name: a/b\n", "1: name = 'a/b': "),
        ("name: a\nspan_m: [0, x]\n", "2: span_m[1] = 'x': "),
        ("name: a\nparts:\n  - kind: drive\n    speed_m: 2\n", "4: parts[0].speed_m: unknown key"),
        ("name: a\nparts:\n  - kind: drive\n    speed_m_s: 2\n", "4: parts[0].speed_m_s = 2: "),
        ("name: a\nparts:\n  - {kind: drive}\n  - kind: brake\n", "4: parts[1].force_n: missing"),
        ("name: a\nnotes: nowhere.txt\n", "2: notes = 'nowhere.txt': expected a file that exists"),
        ("name: a\nname: b\n", "2: name: the key stands twice"),
        ('name: a\n"b\\nc": 1\n', "2: b\\nc: unknown key"),
        ("name: a\nparts: [{kind: drive, kind: brake}]\n", "2: kind: the key stands twice"),
        ("", "1: empty"),
        ("- name\n", "1: a list"),
        ("just words\n", "1: text"),
        ("name: a\n? [b]\n: 1\n", "2: a sequence as key"),
        ("name: a\nparts: &all [*all]\n", "2: *all is an alias"),
        ("name: a\ncount: [1\n", "3: "),
        ("name: a\n---\nname: b\n", "2: "),
        ("name: !!python/object:os.system a\n", "1: 'tag:yaml.org,2002:python/object:os.system' is a tag"),
        ("name: !!timestamp x\n", "1: 'tag:yaml.org,2002:timestamp' is a tag"),
        ("! name: a\n", "1: '!' is a tag"),
        (f"name: a\nratio: 0x{'f' * 5000}\n", " Exceeds the limit"),
        (f"name: a\nnotes: {'x' * 300}\n", "2: notes = "),
        ("name: a\0b\n", "1: "),
        (b"name: \xff\xfe\n", " not UTF-8 text"),
        *((text, " ") for text in ("name: 2020-13-45\n", "count: 0x_\n", "a: " + "[" * 1100, "? " * 1100)),
    ],
)
def test_config_mistake_is_one_line_with_its_place(tmp_path: Path, text: str | bytes, expected: str) -> None:
    assert mistake(tmp_path, text).startswith(f"machine.yaml:{expected}")


@pytest.mark.parametrize("where", ["inbound", "outbound"])
def test_a_replay_stands_for_both_directions(tmp_path: Path, where: str) -> None:
    (tmp_path / "run.mcap").touch()
    text = f"impairment:\n  replay: run.mcap\n  {where}: lan\n"
    with pytest.raises(ConfigurationError, match="yaml:2: impairment: replay: expected neither inbound nor"):
        load_settings(SlaveSettings, written(tmp_path, text))


def test_aliases_that_stand_for_gigabytes_are_refused_before_any_is_written_out(tmp_path: Path) -> None:
    levels = [f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]\n" for i in range(1, 10)]
    tracemalloc.start()
    said = mistake(tmp_path, "".join(["l0: &l0 [x, x, x, x, x, x, x, x, x]\n", *levels]))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert said == "machine.yaml:2: *l0 is an alias; expected plain YAML"
    assert most < 2**20


@given(st.binary(max_size=60))
def test_any_bytes_give_a_mapping_or_one_line(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = written(tmp_path_factory.getbasetemp(), data)
    try:
        assert type(load_yaml(path)[0]) is dict
    except ConfigurationError as error:
        assert str(error).startswith(str(path))
        assert len(str(error).splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "number"),
    [("1e-3", 1e-3), ("-2E+4", -2e4), ("1.e2", 100.0), ("+1e0", 1.0), ("1_000e-3", 1.0), ("3", 3.0)],
)
def test_numbers_as_engineers_write_them(tmp_path: Path, text: str, number: float) -> None:
    value = load_yaml(written(tmp_path, f"a: {text}\n"))[0]["a"]
    assert (type(value) in (int, float), value) == (True, number)


def test_a_relative_path_counts_from_the_file_and_is_absolute_from_then_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "notes.txt").write_text("")
    (folder / "machine.yaml").write_text("name: a\nnotes: notes.txt\n")
    monkeypatch.chdir(tmp_path)
    machine = load_settings(Machine, Path("there/machine.yaml"))
    assert machine.notes == folder / "notes.txt"
    assert load_settings(Machine, written(tmp_path, dump_yaml(machine))) == machine


def test_the_deployed_files_load_and_share_their_limits() -> None:
    slave = load_settings(SlaveSettings, DEPLOY / "slave.yaml")
    master = load_settings(MasterSettings, DEPLOY / "master.yaml")
    assert [axis.name for axis in slave.axes] == [axis.name for axis in master.axes]
    for one, other in zip(slave.axes, master.axes, strict=True):
        ours = shared_text(slave.cell, one.name, one.limits)
        theirs = shared_text(master.cell, other.name, other.limits)
        assert (differences(ours, theirs), settings_hash(ours)) == ("", settings_hash(theirs))


def test_two_axes_of_one_name_are_refused(tmp_path: Path) -> None:
    text = "axes: [{name: a}, {name: a}]\n"
    for kind in (SlaveSettings, MasterSettings):
        with pytest.raises(ConfigurationError, match="expected each name once"):
            load_settings(kind, written(tmp_path, text))


def test_a_force_limit_that_the_simulated_load_cell_can_not_measure_is_refused(tmp_path: Path) -> None:
    text = "axes:\n  - simulation: {preset: guidewire}\n    limits: {max_force_n: %s}\n"
    load_settings(SlaveSettings, written(tmp_path, text % 0.475))
    with pytest.raises(ConfigurationError, match=r"limits\.max_force_n = 0\.476: expected at most 0\.475"):
        load_settings(SlaveSettings, written(tmp_path, text % 0.476))
    (tmp_path / "run.csv").write_text("")
    recorded = text % 9.0 + "    load_cell: {driver: recorded, recording: run.csv}\n"
    load_settings(SlaveSettings, written(tmp_path, recorded))


def test_a_merge_takes_the_override_below_what_both_have_and_changes_neither() -> None:
    base: dict[str, Any] = {"a": {"b": 1, "c": {"d": 2}}, "e": 3, "f": {"g": 4}}
    override: dict[str, Any] = {"a": {"c": {"h": 5}}, "f": 6, "e": {"i": 7}}
    before = deepcopy([base, override])
    assert deep_merge(base, override) == {"a": {"b": 1, "c": {"d": 2, "h": 5}}, "e": {"i": 7}, "f": 6}
    assert [base, override] == before


@pytest.mark.parametrize(
    "theirs", ["", "no JSON", "[]", "null", "3", "[" * 4096, '{"a":' * 800 + "1" + "}" * 800, '"' * 4096]
)
def test_unreadable_settings_of_the_peer_are_said_to_be_so(theirs: str) -> None:
    said = differences(shared_text("lab", "insertion", AxisLimits()), theirs)
    assert said == "the peer's settings are unreadable" or said.startswith("protocol: ")


REAL: dict[str, Any] = {
    "stage": {"driver": "zaber_ascii", "port": "p", "microstep_m": 1e-7, "travel_m": [-0.01, 0.13]},
    "load_cell": {
        "driver": "bota_serial", "port": "q", "full_scale_n": 9500, "pushes_only": False, "filter_lag_s": 0,
    },
    "gripper": {"driver": "simulated"},
}  # fmt: skip
HELD = {"driver": "coil_serial", "port": "h", "counts_per_m": 1e6, "newton_per_ampere": 5, "max_current_a": 1}
END: dict[str, tuple[type[Settings], dict[str, Any]]] = {
    "slave": (SlaveSettings, REAL),
    "master": (MasterSettings, {"handle": HELD}),
}


@pytest.mark.parametrize(
    ("role", "key", "value"),
    [
        ("slave", "gate.stop_deceleration_m_s2", 0.05), ("slave", "gate.watchdog_s", 0.0),
        ("slave", "gate.watchdog_s", 0.3), ("slave", "gate.force_timeout_s", None),
        ("slave", "gate.max_age_s", 1.0), ("slave", "gate.lease_s", 10.0),
        ("slave", "gate.alignment_m", 0.05), ("slave", "gate.engage_ramp_s", 1e-6),
        ("slave", "limits.max_acceleration_m_s2", 1e7), ("slave", "limits.max_force_n", 9000.0),
        ("slave", "limits.stiffest_wall_n_m", 0.001), ("master", "rendering.max_force_n", 50.0),
        ("master", "rendering.max_slew_n_s", 1e4), ("master", "rendering.max_stiffness_n_m", 1e5),
        ("master", "rendering.stale_s", 2.0), ("master", "rendering.fade_s", 5.0),
    ],
)  # fmt: skip
def test_what_switches_a_protection_off_needs_its_name_in_unsafe(role: str, key: str, value: object) -> None:
    (kind, devices), (section, name) = END[role], key.split(".")
    axis = {**deepcopy(devices), section: {name: value}}
    if name == "max_force_n" and role == "master":
        axis[section]["max_slew_n_s"] = 300.0
    checked(kind, {"axes": [{**devices}]}, "f")
    with pytest.raises(ConfigurationError, match=rf"{key} = .* or the line unsafe: \[{key}\]"):
        checked(kind, {"axes": [axis]}, "f")
    checked(kind, {"axes": [{**axis, "unsafe": [key]}]}, "f")
    simulated = {place: each for place, each in axis.items() if place not in {"stage", "handle"}}
    checked(kind, {"axes": [simulated]}, "f")  # nobody to protect
    with pytest.raises(ConfigurationError, match="is not beyond its bound"):
        checked(kind, {"axes": [{**devices, "unsafe": [key]}]}, "f")


def test_what_an_axis_does_without_stands_in_one_list() -> None:
    axis = {**REAL, "gate": {"lease_s": 5}, "unsafe": ["gate.lease_s"] * 300}
    assert checked(SlaveSettings, {"axes": [axis]}, "f").axes[0].caveats == (
        "no hardware: gripper (simulated)", "uncalibrated: stage, load_cell", "unsafe: gate.lease_s = 5.0",
    )  # fmt: skip
    assert MasterSettings().axes[0].caveats == ("no hardware: handle (operator)",)
    assert checked(MasterSettings, {"axes": [{"handle": HELD}]}, "f").axes[0].caveats == ()
