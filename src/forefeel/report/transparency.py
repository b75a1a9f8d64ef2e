"""Transparency: the force that the hand felt, against the one that it should have felt of the same command.

With s the `force_scale` and r the reference, over the commands that were sent while the slave followed:

    error = felt - s r,   R = rms(felt - s r) / rms(s held - s r),   JND = max(7 % of |s r|, 30 mN)

Held: the newest force that had arrived. r is the force of a noise-free twin of the simulated world, which
answers a command at once; or, as measured, the first force that the slave measured while it followed the
motion of the command, laid back by its way. JND: the just noticeable difference of a force at the hand, 5 to
10 % of it (Pang, Tan, Durlach 1991); the finger's absolute threshold is 29 to 44 mN (docs/how-to/tuning.md).
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np

from forefeel.common.error_size import ErrorSize, Floats
from forefeel.common.errors import DeviceError
from forefeel.common.limiter import MotionLimiter
from forefeel.common.messages import MotionCommand
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.time_offset import time_offset_s
from forefeel.common.topics import COMMAND, FORCE, HAPTICS, MASTER_STATE
from forefeel.report.score import compare
from forefeel.report.traces import CommandTraces
from forefeel.slave.plant.world import SimulatedWorld
from forefeel.slave.settings import SlaveAxisSettings

JND_SHARE, JND_FLOOR_N = 0.07, 0.030
_TICK_NS = 1_000_000
_MAX_STEP_S = 0.010  # s, of the slave's limiter too


@dataclass(frozen=True, slots=True)
class Transparency:
    """Errors at the hand in N; `ratio`: R; `jnd_rms`: rms of error / JND; `within_jnd`: share below one.
    `offset_s`, `held_offset_s`: time offset of the felt and of the held force, above 0: late.
    """

    commands: int = 0
    felt: ErrorSize = field(default_factory=ErrorSize)
    held: ErrorSize = field(default_factory=ErrorSize)
    ratio: float | None = None
    jnd_rms: float | None = None
    within_jnd: float | None = None
    offset_s: float | None = None
    held_offset_s: float | None = None


class Twin:
    """The slave's world and limits without noise, loss and delay: it gets each command when it is sent.

    Its clock runs `ahead_ns` before the commands' stamps, so that heart and breath are where a command meets
    them when it arrives. `start_ns`: when the world began, on the clock in which a command arrives.
    """

    def __init__(self, settings: SlaveAxisSettings, start_ns: int, ahead_ns: int) -> None:
        cell = settings.simulation.load_cell.model_copy(update={"noise_n": 0.0})
        simulation = settings.simulation.model_copy(update={"load_cell": cell})
        self._world = SimulatedWorld(simulation, settings.seed)
        self._world.advance(start_ns)
        self._limiter = MotionLimiter(settings.limits, settings.gate.stop_deceleration_m_s2)
        self._limiter.reaction, self._limiter.age_s = settings.reaction(), 0.0
        self._ahead_ns = ahead_ns
        self._previous_ns = start_ns
        self._force_n = 0.0

    def force_n(self, command: MotionCommand) -> float:
        """Moves the twin by a command, in the order of the stamps; returns the force in N that answers it, a
        tick after it arrives. Without the deadman the setpoint jumps to the command's position.
        """
        arrived_ns = command.stamp_ns + self._ahead_ns
        dt_s = min(max((arrived_ns - self._previous_ns) * 1e-9, 1e-6), _MAX_STEP_S)
        self._previous_ns = arrived_ns
        if command.deadman:
            self._limiter.follow(
                command.position_m, command.velocity_m_s, self._force_n, dt_s, band_n=command.band_n
            )
        else:
            self._limiter.place(command.position_m)
        self._world.set_target(self._limiter.position_m, self._limiter.velocity_m_s, arrived_ns)
        self._world.grip(command.gripper)
        self._world.advance(arrived_ns + _TICK_NS)
        self._force_n = self._world.load_cell_reading().force_n
        return self._force_n


def transparency(felt_n: Floats, held_n: Floats, true_n: Floats) -> Transparency:
    """Scores felt and held force against the true one, all in N at the hand, over the rows that have all
    three; an empty `Transparency` where none has.
    """
    compared = compare(felt_n, held_n, true_n)
    if not compared.commands:
        return Transparency()
    jnd_n = np.maximum(JND_SHARE * np.abs(true_n), JND_FLOOR_N)
    errors = np.abs(felt_n - true_n) / jnd_n
    errors = errors[np.isfinite(errors) & np.isfinite(held_n)]
    jnd_rms, within = float(np.sqrt(np.mean(errors**2))), float(np.mean(errors <= 1.0))
    return Transparency(compared.commands, compared.prediction, compared.zoh, compared.ratio, jnd_rms, within)


def against_twin(run: Run, axis: str, commands: CommandTraces) -> Transparency | None:
    """Scores the force felt at one axis against that of the twin; None where the settings of its simulated
    world were not recorded, no command was followed, or none can be scored.
    """
    try:
        settings = SlaveAxisSettings.model_validate_json(run.metadata.get("run", {})["slave_axis"])
    except (KeyError, ValueError):
        return None
    if settings.name != axis or not commands.followed.any():
        return None
    return _scored(run, axis, commands, _true_n(run, axis, settings))


def as_measured(run: Run, axis: str, commands: CommandTraces) -> Transparency | None:
    """Transparency of one axis by the measured force; None where no followed command has one."""
    return _scored(run, axis, commands, commands.force_n)


def _scored(run: Run, axis: str, commands: CommandTraces, contact_n: Floats) -> Transparency | None:
    """Scores felt and held force of the followed commands against `contact_n`, the true force in N at the
    contact, and finds their time offsets; None where no row has all forces, or the scale of the force to the
    hand was not recorded.
    """
    scale = _force_scale(run, axis)
    rows = commands.followed & np.isfinite(scale * contact_n)
    felt_n, held_n, true_n = commands.rendered_n[rows], scale * commands.zoh_n[rows], scale * contact_n[rows]
    scored = transparency(felt_n, held_n, true_n)
    if not scored.commands:
        return None
    offset_s, held_offset_s = (
        time_offset_s(commands.time_s[rows], shown_n, true_n) for shown_n in (felt_n, held_n)
    )
    return replace(scored, offset_s=offset_s, held_offset_s=held_offset_s)


def _force_scale(run: Run, axis: str) -> float:
    """Newest scale of the force to the hand, from the master's reports, else the metadata; NaN without."""
    newest = run.column(axis, MASTER_STATE, "force_scale")[-1:].astype(np.float64)
    if (newest > 0.0).any():
        return float(newest[0])
    try:
        return float(run.metadata["run"]["force_scale"])  # there up to protocol 6
    except (KeyError, ValueError):
        return np.nan


def _true_n(run: Run, axis: str, settings: SlaveAxisSettings) -> Floats:
    """Force of the twin in N for each row of the commands' traces, the recorded commands played to it in
    order; NaN where the command was not recorded, and for all from the first DeviceError of the world on.
    """
    stamp_ns, sequence = (run.column(axis, FORCE, name) for name in ("stamp_ns", "sequence"))
    # a force is sent in each tick, the first when the world begins
    start_ns = int(stamp_ns[0]) - int(sequence[0] - 1) * _TICK_NS
    answer_ns = float(np.nanmedian(stamp_ns - run.column(axis, FORCE, "answers_stamp_ns")))
    twin = Twin(settings, start_ns, round(answer_ns) - _TICK_NS)
    sent = sorted(run.messages(axis, COMMAND), key=attrgetter("stamp_ns"))
    true_n: dict[tuple[int, int], float] = {}
    with suppress(DeviceError):
        for command in sent:
            true_n[command.session_id, command.sequence] = twin.force_n(command)
    ids = zip(*(run.column(axis, HAPTICS, name).tolist() for name in ("session_id", "sequence")), strict=True)
    return np.array([true_n.get(command_id, np.nan) for command_id in ids])
