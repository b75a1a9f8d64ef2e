"""Plan of a loopback run: the settings of both ends, from a preset or from a measured recording."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from forefeel.common.causes.base import ContactEffect, ForceEffect
from forefeel.common.config import Settings, checked, dump_yaml, load_settings
from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.model_file import load_model
from forefeel.common.recording.units import Mapping
from forefeel.common.settings import AxisLimits
from forefeel.common.transport.settings import PRESETS
from forefeel.devices.mujoco.settings import GuidewireSettings
from forefeel.devices.simulated.settings import OperatorSettings
from forefeel.loopback.viewer import CELL
from forefeel.master.prior import load
from forefeel.master.settings import MasterSettings, PredictionSettings
from forefeel.report.vessel import RECORDED, VesselSettings
from forefeel.slave.plant.presets import PRESETS as WORLDS
from forefeel.slave.plant.settings import WorldSettings
from forefeel.slave.settings import SlaveSettings

if TYPE_CHECKING:
    from forefeel.common.recording.recording import Array, Recording

AXIS = "insertion"
OUR_WORLDS = Path(__file__).parents[1] / "devices" / "mujoco"
STATE = "state"
"""Folder of both ends' event logs and flight records."""
PRIOR, MODEL = "prior", "model"
"""Names in the metadata table `run` of what the prediction starts from, as JSON; each is there if used."""
DEFAULT_DURATION_S = 20.0  # s of a run
_DEFAULT_PRESET = "catheter"
_WORLD_MAX_N = {"catheter": 3.0, "guidewire": 0.3}
"""Force limit in a simulated world: about three times what its instrument meets."""
# guidewire forces lie near the absolute threshold of the finger and are felt only when scaled
_GUIDEWIRE_SCALE = 10.0
HAND_MAX_N = 4.0
"""Force in N that the hand is given at most."""
_QUICKEST_M_S2 = 1000.0  # that the settings admit: coarse stamps let a velocity step farther in a millisecond
_APPROACH_M_S = 0.03  # m/s, fastest approach to the recording's start
# drawn lengths of the guide before its end, and of the vessel beyond the reach of the wire
_GUIDE_MM, _BEYOND_MM = 30.0, 10.0
# A simulated world says where its wall begins and not how wide it is: radii in those of the instrument,
# wider up to there and narrower beyond, for the wall resists more the deeper.
_ENTRANCE, _INSTRUMENT, _DEEPEST = 2.6, 1.0, 0.7


@dataclass(frozen=True, slots=True)
class LoopbackOptions:
    seed: int = 0
    impairment: str = "none"
    preset: str | None = None
    world: str | None = None
    duration_s: float | None = None
    recording: Path | None = None
    columns: Mapping = field(default_factory=Mapping)
    slave_model: Path | None = None
    master_model: Path | None = None
    hide: Path | None = None
    hide_at_s: float = 0.0
    prior_dir: Path | None = None
    patient: str | None = None
    accept_prior: bool = False
    hardware: str = "simulated"


class WorldFile(Settings):
    """A world of others, with what an axis needs to move in it: limits, the scale of the force to the hand,
    strokes of the synthetic operator.
    """

    simulation: WorldSettings
    limits: AxisLimits = AxisLimits()
    force_scale: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    operator: OperatorSettings = OperatorSettings()


@dataclass(frozen=True, slots=True)
class Plan:
    """Settings of both ends; `duration_s` None: until the recording was played. `notes`: for the user."""

    slave: dict[str, Any]
    master: dict[str, Any]
    duration_s: float | None
    expected_s: float
    notes: tuple[str, ...]
    metadata: dict[str, str]

    def slave_settings(self) -> SlaveSettings:
        return checked(SlaveSettings, self.slave, self._where("slave"))

    def master_settings(self) -> MasterSettings:
        return checked(MasterSettings, self.master, self._where("master"))

    def recorded(self) -> dict[str, str]:
        """Metadata for the recording, as text by name: the run's, the vessel if there is one, and, if stage
        and load cell are simulated, the slave's axis.
        """
        axis, vessel = self.slave_settings().axes[0], self.vessel()
        drawn = {} if vessel is None else {RECORDED: vessel.model_dump_json()}
        if {axis.stage.driver, axis.load_cell.driver} != {"simulated"}:
            return {**self.metadata, **drawn}
        return {**self.metadata, **drawn, "slave_axis": axis.model_dump_json()}

    def vessel(self) -> VesselSettings | None:
        """Vessel to draw of the simulated world; None where recorded forces or another engine take its place,
        unless that is the guidewire by MuJoCo.
        """
        axis = self.slave_settings().axes[0]
        world = axis.simulation.world
        if axis.load_cell.driver == "recorded":
            return None
        if isinstance(world, GuidewireSettings):
            return _bent_vessel(axis.simulation, world, axis.name)
        return _vessel(axis.simulation, axis.name) if world is None else None

    def _where(self, role: str) -> str:
        return f"loopback {role}, recording {self.metadata['recording']}"

    def write(self, directory: Path) -> tuple[Path, Path]:
        """Writes both effective settings as YAML: what the two processes are started with."""
        paths = directory / "slave.yaml", directory / "master.yaml"
        for path, settings in zip(paths, (self.slave_settings(), self.master_settings()), strict=True):
            path.write_text(dump_yaml(settings), encoding="utf-8")
        return paths


def _vessel(world: WorldSettings, axis: str) -> VesselSettings:
    """Vessel to draw for a simulated world, in mm and not to scale: it narrows to the contact and beyond;
    with a valve at 0 where an effect acts along the shaft.
    """
    hidden = world.hidden.effects.effects if world.hidden else ()
    effects = [(entry.instance(), entry.site) for entry in (*world.contact.effects, *hidden)]
    shaft = [e for e, site in effects if isinstance(e, ForceEffect) and (site or e.site) == "shaft"]
    begins = [1e3 * e.values["contact_position_m"] for e, _ in effects if isinstance(e, ContactEffect)]
    contact_mm, tip_mm = max([0.0, *begins]), 1e3 * (world.fixture.inserted_m - world.stage.start_m)
    end_mm = max(1e3 * world.stage.travel_upper_m + tip_mm, contact_mm + 1.0)
    return VesselSettings(
        axis=axis,
        tip_mm=tip_mm,
        instrument_radius_mm=_INSTRUMENT,
        lumen_radius_mm={0.0: _ENTRANCE, contact_mm: _INSTRUMENT, end_mm: _DEEPEST},
        landmarks_mm=({"valve": 0.0} if shaft else {}) | ({"contact": contact_mm} if contact_mm else {}),
        to_scale=False,
    )


def _bent_vessel(simulation: WorldSettings, world: GuidewireSettings, axis: str) -> VesselSettings:
    """Curved vessel to draw of a guidewire's world, in mm from the end of the guide: from `_GUIDE_MM` before
    it to `_BEYOND_MM` beyond the reach of the wire.
    """
    from forefeel.devices.mujoco.path import vessel_path  # noqa: PLC0415 - it loads scipy

    tip_mm = 1e3 * (world.inserted_m - simulation.stage.start_m)
    end_mm = tip_mm + 1e3 * simulation.stage.travel_upper_m
    path, at_mm = vessel_path(world), np.arange(-_GUIDE_MM, end_mm + _BEYOND_MM).tolist()
    return VesselSettings(
        axis=axis,
        tip_mm=tip_mm,
        instrument_radius_mm=1e3 * world.wire.radius_m,
        lumen_radius_mm=dict.fromkeys((0.0, end_mm), 500.0 * world.lumen_m),
        landmarks_mm={},
        walls_mm={mm: np.round(1e3 * path.walls_m(world.guide_m + 1e-3 * mm), 2).tolist() for mm in at_mm},
    )


def make_plan(options: LoopbackOptions) -> Plan:
    """Plan of a run: checks the options, loads recording and models, makes both ends' settings as mappings,
    not yet validated, with duration, notes and metadata. Nothing is written.

    Raises:
        InputError: an option out of range, or not beside another; an unknown preset, or a file that can not
            be used.
    """
    _check_options(options)
    slave_axis, master_axis = _axes(options)
    duration_s: float | None
    duration_s = expected_s = options.duration_s or DEFAULT_DURATION_S
    notes: tuple[str, ...] = ()
    if options.recording is not None:
        from forefeel.common.recording.loading import load_recording  # noqa: PLC0415 - most runs play none

        recording = load_recording(options.recording, options.columns)
        if all(piece.stop - piece.start < 2 for piece in recording.segments()):
            raise RecordingError(f"{options.recording}: no two samples within {GAP_S:g} s, nothing to play")
        if recording.force_n is not None:
            _refuse_world_options(options)
        notes = play(recording, _source(options), slave_axis, master_axis)
        duration_s = options.duration_s
        expected_s = min(duration_s or recording.duration_s, recording.duration_s)
    _enter_models(options, slave_axis, master_axis)
    metadata = _metadata(options)
    if options.prior_dir is not None:
        master_axis.setdefault("prediction", {}).update(
            prior_dir=str(options.prior_dir.resolve()),
            instrument=_instrument(options),
            patient=options.patient or "simulated",
        )
        wanted = checked(PredictionSettings, master_axis["prediction"], "--prior-dir")
        prior, _ = load(wanted, options.accept_prior)
        if prior is not None:
            metadata[PRIOR] = json.dumps(asdict(prior))  # before the run, which replaces what is stored
    if options.master_model is not None:
        metadata[MODEL] = json.dumps(load_model(options.master_model).to_mapping())
    both = {"cell": CELL, "impairment": {"inbound": options.impairment, "seed": options.seed}}
    return Plan(
        slave={**both, "axes": [slave_axis]},
        master={**both, "axes": [master_axis], "accept_prior": options.accept_prior},
        duration_s=duration_s,
        expected_s=expected_s,
        notes=notes,
        metadata=metadata,
    )


def _check_options(options: LoopbackOptions) -> None:
    """Raises ConfigurationError: unknown impairment or preset, `--preset` or `--slave-model` beside
    `--world`, duration out of range, a file as `--prior-dir`, `--patient` or `--accept-prior` without it.
    """
    if options.impairment not in PRESETS:
        raise ConfigurationError(f"--impairment {options.impairment!r}: expected one of {', '.join(PRESETS)}")
    for option, value in (("--preset", options.preset), ("--slave-model", options.slave_model)):
        if options.world is not None and value is not None:
            raise ConfigurationError(f"{option} {value}: expected only without --world")
    if options.preset is not None and options.preset not in WORLDS:
        raise ConfigurationError(f"--preset {options.preset!r}: expected one of {', '.join(WORLDS)}")
    if options.duration_s is not None and not 0.5 <= options.duration_s <= 86_400:
        raise ConfigurationError(f"--duration {options.duration_s:g}: expected 0.5 to 86400 s")
    if options.prior_dir is not None and options.prior_dir.exists() and not options.prior_dir.is_dir():
        raise ConfigurationError(f"--prior-dir {options.prior_dir}: is a file; expected a folder")
    if options.prior_dir is None and (options.patient is not None or options.accept_prior):
        option = "--accept-prior" if options.patient is None else f"--patient {options.patient}"
        raise ConfigurationError(f"{option}: expected only with --prior-dir")


def _axes(options: LoopbackOptions) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings, as mappings, of the slave's and the master's axis, from preset or `--world`: simulated world,
    limits, synthetic operator, and the scale of the force to the hand.
    """
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
    if options.world is not None:
        world = _world_file(options.world)
        limits |= world.limits.model_dump(mode="json", exclude_unset=True)
        slave_axis["simulation"] = world.simulation.model_dump(mode="json")
        master_axis["rendering"]["force_scale"] = world.force_scale
        master_axis["handle"] |= world.operator.model_dump(mode="json", exclude_unset=True)
    return slave_axis, master_axis


def _world_file(name: str) -> WorldFile:
    """Loads an installed world by name, else a YAML file. ConfigurationError: none, or a mistake in it."""
    ours = {path.name.removesuffix(".yaml"): path for path in OUR_WORLDS.glob("*.yaml")}
    path = ours.get(name, Path(name))
    if path.suffix != ".yaml" and not path.exists():
        known = ", ".join(sorted(ours))
        raise ConfigurationError(f"--world {name}: no such file; expected a YAML file, or one of {known}")
    return load_settings(WorldFile, path)


def _instrument(options: LoopbackOptions) -> str:
    return options.preset or (Path(options.world).stem if options.world else _DEFAULT_PRESET)


def _metadata(options: LoopbackOptions) -> dict[str, str]:
    """Metadata of the run, as text by name: seed, impairment, preset, recording, models, hidden effects."""
    return {
        "seed": str(options.seed),
        "impairment": options.impairment,
        "preset": _instrument(options),
        "recording": options.recording.name if options.recording else "none: synthetic operator",
        "slave_model": options.slave_model.name if options.slave_model else "preset",
        "master_model": options.master_model.name if options.master_model else "m, b, k, bias and friction",
        "hidden": f"{options.hide.name} from {options.hide_at_s:g} s on" if options.hide else "nothing",
    }


def _enter_models(options: LoopbackOptions, slave_axis: dict[str, Any], master_axis: dict[str, Any]) -> None:
    """Checks the model files that the options name and enters their paths into the settings of both axes, in
    place, the one of `--hide` into the slave's world (`_hide`). Raises ConfigurationError: no model, a
    `--master-model` without a linear parameter, or as `_hide`.
    """
    if options.slave_model is not None:
        load_model(options.slave_model)  # for an error that names the file and nothing around it
        slave_axis["simulation"]["model"] = str(options.slave_model.resolve())
    _hide(options, slave_axis)
    if options.master_model is not None:
        if not load_model(options.master_model).runtime().linear_names:
            raise ConfigurationError(f"{options.master_model}: no linear parameter; expected one to identify")
        master_axis.setdefault("prediction", {})["model"] = str(options.master_model.resolve())


def _hide(options: LoopbackOptions, slave_axis: dict[str, Any]) -> None:
    """Enters the model of `--hide`, and when it acts, into the slave's simulated world, in place; nothing
    without it. ConfigurationError: no model, or `--hide-at` out of range or without `--hide`.
    """
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
    if options.columns != Mapping():
        source["columns"] = asdict(options.columns)
    return source


def _refuse_world_options(options: LoopbackOptions) -> None:
    """Raises ConfigurationError for `--preset`, `--world`, `--slave-model`, `--hide` or `--prior-dir`:
    recorded forces take the place of the simulated instrument.
    """
    for option, value in (
        ("--preset", options.preset),
        ("--world", options.world),
        ("--slave-model", options.slave_model),
        ("--hide", options.hide),
        ("--prior-dir", options.prior_dir),
    ):
        if value is not None:
            raise ConfigurationError(
                f"{option} {value}: the recording has forces, nothing is simulated; "
                "expected one of them (--time and --position alone leave out the forces)"
            )


def play(
    recording: "Recording", source: dict[str, Any], slave_axis: dict[str, Any], master_axis: dict[str, Any]
) -> tuple[str, ...]:
    """Changes the settings of both axes, in place, so that they play the recording: limits, stage, handle,
    and the recorded force where there is one. Returns notes for the user. `source`: the recording as the
    settings of a device name it.
    """
    limits = recording_limits(recording, slave_axis["limits"]["max_force_n"])
    low, high = limits["workspace_m"]
    span = high - low
    slave_axis["limits"] = master_axis["limits"] = limits
    slave_axis["gate"] = {"alignment_m": float(np.clip(0.05 * span, 2e-5, 1e-3))}
    slave_axis["simulation"]["stage"] = {
        "travel_lower_m": low,
        "travel_upper_m": high,
        "start_m": float(recording.position_m[0]),
        "velocity_limit_m_s": 2 * limits["max_velocity_m_s"],
        "acceleration_limit_m_s2": min(2 * limits["max_acceleration_m_s2"], _QUICKEST_M_S2),
        "encoder_step_m": min(1e-6, span * 1e-5),
    }
    master_axis["handle"] = {
        "driver": "recording",
        "approach_m_s": min(_APPROACH_M_S, limits["max_velocity_m_s"] / 2),
        **source,
    }
    notes = _notes(recording, limits)
    if recording.force_n is None:
        return (*notes, "no force column: the motion drives the simulated vessel")
    return (*notes, *_play_force(recording, recording.force_n, source, slave_axis, master_axis))


def _play_force(
    recording: "Recording",
    force_n: "Array",
    source: dict[str, Any],
    slave_axis: dict[str, Any],
    master_axis: dict[str, Any],
) -> list[str]:
    """Changes the settings of both axes, in place, so that the load cell plays the recorded force, turned to
    resist insertion, without timeout, and the hand gets it, scaled down where it is over `HAND_MAX_N`.
    Returns notes for the user. `source`: settings of the load cell that name the recording; only read.
    """
    sign = resisting_sign(recording)
    slave_axis["load_cell"] = {"driver": "recorded", "force_sign": sign, **source}
    slave_axis["gate"]["force_timeout_s"] = None
    strongest_n = float(np.max(np.abs(force_n)))
    scale = min(1.0, HAND_MAX_N / strongest_n) if strongest_n > 0 else 1.0
    master_axis["rendering"] = {"force_scale": scale, "max_force_n": HAND_MAX_N}
    notes = [f"force scale to the hand {scale:.3g}"]
    if sign < 0:
        notes.append(
            "force sign turned: as recorded the contact would give energy; here positive resists insertion"
        )
    return notes


def resisting_sign(recording: "Recording") -> Literal[1, -1]:
    """1 where the recorded force resists insertion, -1 where it is the reaction to that. `recording`: with a
    force.

    A contact is passive: over the whole recording it absorbs energy, the integral of F dx is positive. The
    force's mean does not count.
    """
    assert recording.force_n is not None
    force_n, work_j = recording.force_n - recording.force_n.mean(), 0.0
    for piece in recording.segments():
        between = 0.5 * (force_n[piece][1:] + force_n[piece][:-1])
        work_j += float(between @ np.diff(recording.position_m[piece]))
    return -1 if work_j < 0 else 1


def recording_limits(recording: "Recording", world_max_n: float) -> dict[str, Any]:
    """Limits of an axis, by name of its settings, that let the recorded motion through: range, speed, force,
    and acceleration by the largest step of speed between samples, as in 1 ms; all with margins.

    `world_max_n`: the force limit where no force was recorded.
    """
    low, high = float(recording.position_m.min()), float(recording.position_m.max())
    margin = max(0.05 * (high - low), 1e-5)
    speed, step = 0.0, 0.0
    for piece in recording.segments():
        velocity = np.diff(recording.position_m[piece]) / np.diff(recording.time_s[piece])
        speed = max(speed, float(np.max(np.abs(velocity), initial=0.0)))
        step = max(step, float(np.max(np.abs(np.diff(velocity)), initial=0.0)))
    forces_n = recording.force_n
    strongest_n = None if forces_n is None else float(np.max(np.abs(forces_n)))
    return {
        "workspace_m": (low - margin, high + margin),
        "max_velocity_m_s": _round_up(max(1.5 * speed, 0.005)),
        "max_acceleration_m_s2": min(_round_up(max(1.5 * step / 1e-3, 1.0)), _QUICKEST_M_S2),
        "max_force_n": world_max_n if strongest_n is None else _round_up(max(1.2 * strongest_n, 0.01)),
    }


def _round_up(value: float) -> float:
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / unit) * unit:.6g}")


def _notes(recording: "Recording", limits: dict[str, Any]) -> tuple[str, ...]:
    """Two notes for the user: samples, duration and pieces of the recording, and the limits taken from it."""
    low, high = limits["workspace_m"]
    pieces = len(recording.segments())
    return (
        f"recording {recording.name}: {len(recording.time_s)} samples, {recording.duration_s:.1f} s, "
        f"{pieces} piece{'s' if pieces > 1 else ''} without a gap over {GAP_S:g} s",
        f"limits from it: {low * 1e3:.3f} to {high * 1e3:.3f} mm, {limits['max_velocity_m_s'] * 1e3:g} mm/s, "
        f"{limits['max_acceleration_m_s2']:g} m/s², {limits['max_force_n']:g} N",
    )
