"""What a loopback run does: the settings of both ends, from a preset or from a measured recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forefeel.calibrate.embedded import calibrations
from forefeel.common.config import checked, dump_yaml
from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.common.model_file import load_model
from forefeel.common.recording.tabular import load_recording
from forefeel.common.recording.units import Mapping
from forefeel.common.transport.settings import PRESETS
from forefeel.loopback.played import GAP_S, HAND_MAX_N, play
from forefeel.master.settings import MasterSettings
from forefeel.slave.plant.presets import PRESETS as WORLDS
from forefeel.slave.settings import SlaveSettings

AXIS = "insertion"
STATE = "state"
"""Folder of both ends' event logs and flight records."""
DEFAULT_DURATION_S = 20.0  # s of a run; chosen, not measured: shorter tells less of the model that it learns
_DEFAULT_PRESET = "catheter"
_WORLD_MAX_N = {"catheter": 3.0, "guidewire": 0.3}
"""Force limit in a simulated world: about three times what its instrument meets."""
# guidewire forces lie near the absolute threshold of the finger and are felt only when scaled
_GUIDEWIRE_SCALE = 10.0


@dataclass(frozen=True, slots=True)
class LoopbackOptions:
    """What the user asked for on the command line."""

    seed: int = 0
    impairment: str = "none"
    preset: str | None = None
    duration_s: float | None = None
    recording: Path | None = None
    columns: Mapping | None = None
    slave_model: Path | None = None
    master_model: Path | None = None
    hide: Path | None = None
    hide_at_s: float = 0.0
    hardware: str = "simulated"


@dataclass(frozen=True, slots=True)
class Plan:
    """Settings of both ends; `duration_s` None: until the recording has been played. `notes`: what to tell
    the user.
    """

    slave: dict[str, Any]
    master: dict[str, Any]
    duration_s: float | None
    expected_s: float
    notes: tuple[str, ...]
    metadata: dict[str, str]

    def slave_settings(self) -> SlaveSettings:
        """The slave's settings, validated."""
        return checked(SlaveSettings, self.slave, self._where("slave"))

    def master_settings(self) -> MasterSettings:
        """The master's settings, validated."""
        return checked(MasterSettings, self.master, self._where("master"))

    def tables(self) -> dict[str, dict[str, str]]:
        """What the recording says of the run: what was asked for, and the calibrations of the slave's
        devices.
        """
        return {"run": self.metadata, **calibrations(self.slave_settings())}

    def _where(self, role: str) -> str:
        return f"loopback {role}, recording {self.metadata['recording']}"

    def write(self, directory: Path) -> tuple[Path, Path]:
        """Writes both effective settings as YAML: what the two processes are started with."""
        paths = directory / "slave.yaml", directory / "master.yaml"
        for path, settings in zip(paths, (self.slave_settings(), self.master_settings()), strict=True):
            path.write_text(dump_yaml(settings), encoding="utf-8")
        return paths


def make_plan(options: LoopbackOptions) -> Plan:
    """Settings of both ends for what the user asked.

    Raises:
        InputError: an unknown preset, or a file that can not be used.
    """
    _check(options)
    slave_axis, master_axis = _axes(options)
    duration_s: float | None
    duration_s = expected_s = options.duration_s or DEFAULT_DURATION_S
    notes: tuple[str, ...] = ()
    if options.recording is not None:
        recording = load_recording(options.recording, options.columns)
        if all(piece.stop - piece.start < 2 for piece in recording.segments(GAP_S)):
            raise RecordingError(f"{options.recording}: no two samples within {GAP_S:g} s, nothing to play")
        if recording.force_n is not None:
            _refuse_world_options(options)
        notes = play(recording, _source(options), slave_axis, master_axis)
        duration_s = options.duration_s
        expected_s = min(duration_s or recording.duration_s, recording.duration_s)
    _load_models(options, slave_axis, master_axis)
    link = {"inbound": options.impairment, "seed": options.seed}
    return Plan(
        slave={"cell": "loopback", "impairment": link, "axes": [slave_axis]},
        master={"cell": "loopback", "impairment": link, "axes": [master_axis]},
        duration_s=duration_s,
        expected_s=expected_s,
        notes=notes,
        metadata=_metadata(options),
    )


def _check(options: LoopbackOptions) -> None:
    """Names and numbers of the command line."""
    if options.impairment not in PRESETS:
        raise ConfigurationError(f"--impairment {options.impairment!r}: expected one of {', '.join(PRESETS)}")
    if options.preset is not None and options.preset not in WORLDS:
        raise ConfigurationError(f"--preset {options.preset!r}: expected one of {', '.join(WORLDS)}")
    if options.duration_s is not None and not 0.5 <= options.duration_s <= 86_400:
        raise ConfigurationError(f"--duration {options.duration_s:g}: expected 0.5 to 86400 s")


def _axes(options: LoopbackOptions) -> tuple[dict[str, Any], dict[str, Any]]:
    """The axis of the slave and of the master, in the world of a preset."""
    preset = options.preset or _DEFAULT_PRESET
    limits = {"max_force_n": _WORLD_MAX_N[preset]}
    slave_axis: dict[str, Any] = {
        "name": AXIS,
        "seed": options.seed,
        "limits": limits,
        "simulation": {"preset": preset},
    }
    scale = _GUIDEWIRE_SCALE if preset == "guidewire" else 1.0
    master_axis: dict[str, Any] = {
        "name": AXIS,
        "limits": limits,
        "handle": {"driver": "operator", "seed": options.seed},
        "rendering": {"force_scale": scale, "max_force_n": HAND_MAX_N},
    }
    return slave_axis, master_axis


def _metadata(options: LoopbackOptions) -> dict[str, str]:
    return {
        "seed": str(options.seed),
        "impairment": options.impairment,
        "preset": options.preset or _DEFAULT_PRESET,
        "recording": options.recording.name if options.recording else "none: synthetic operator",
        "slave_model": options.slave_model.name if options.slave_model else "preset",
        "master_model": options.master_model.name if options.master_model else "m, b, k, bias and friction",
        "hidden": f"{options.hide.name} from {options.hide_at_s:g} s on" if options.hide else "nothing",
    }


def _load_models(options: LoopbackOptions, slave_axis: dict[str, Any], master_axis: dict[str, Any]) -> None:
    if options.slave_model is not None:
        load_model(options.slave_model)  # for an error that names the file and nothing around it
        slave_axis["simulation"]["model"] = str(options.slave_model.resolve())
    _hide(options, slave_axis)
    if options.master_model is not None:
        if not load_model(options.master_model).runtime().linear_names:
            raise ConfigurationError(f"{options.master_model}: no linear parameter; expected one to identify")
        master_axis.setdefault("prediction", {})["model"] = str(options.master_model.resolve())


def _hide(options: LoopbackOptions, slave_axis: dict[str, Any]) -> None:
    """Adds the effects of `--hide` to the simulated world; the master hears nothing of them."""
    if options.hide is None:
        if options.hide_at_s:
            raise ConfigurationError(f"--hide-at {options.hide_at_s:g}: expected only with --hide")
        return
    if not 0.0 <= options.hide_at_s <= 86_400:
        raise ConfigurationError(f"--hide-at {options.hide_at_s:g}: expected 0 to 86400 s")
    load_model(options.hide)
    hidden = {"model": str(options.hide.resolve()), "from_s": options.hide_at_s}
    slave_axis["simulation"]["hidden"] = hidden


def _source(options: LoopbackOptions) -> dict[str, Any]:
    source: dict[str, Any] = {"recording": str(Path(options.recording or "").resolve())}
    if options.columns is not None:
        source["columns"] = {
            "time": options.columns.time,
            "position": options.columns.position,
            "force": options.columns.force,
        }
    return source


def _refuse_world_options(options: LoopbackOptions) -> None:
    """Recorded forces take the place of the simulated instrument."""
    for option, value in (
        ("--preset", options.preset),
        ("--slave-model", options.slave_model),
        ("--hide", options.hide),
    ):
        if value is not None:
            raise ConfigurationError(
                f"{option} {value}: the recording has forces, nothing is simulated; "
                "expected one of them (--time and --position alone leave out the forces)"
            )
