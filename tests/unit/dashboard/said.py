"""Messages of a cell of which every figure is known, and a cell that heard them."""

from collections.abc import Iterator
from math import sin
from typing import Any

from forefeel.common.codec import encode
from forefeel.common.messages import (
    ForceSample,
    HapticSample,
    LimitEvent,
    LoopTiming,
    MasterState,
    Message,
    ModelParameters,
    SafetyEvent,
    SlaveState,
)
from forefeel.common.topics import (
    FORCE,
    HAPTICS,
    LIMIT_EVENT,
    MASTER_STATE,
    MASTER_TIMING,
    PARAMETERS,
    SLAVE_STATE,
    Topic,
)
from forefeel.dashboard.axis_view import AxisView
from forefeel.dashboard.cell_view import CellView

MS = 1_000_000
S = 1000 * MS
CELL, AXIS = "cathlab", "insertion"
SESSION = 77
AHEAD_NS = 40 * S
"""So much is the slave's clock ahead of the master's."""
HOSTILE = "<img src=x onerror=\"document.title='taken'\"><b>bold</b>"


def header(sequence: int, stamp_ns: int) -> dict[str, Any]:
    return {"session_id": SESSION, "sequence": sequence, "stamp_ns": stamp_ns}


def haptics(sequence: int, stamp_ns: int, **changes: object) -> HapticSample:
    force_n = wave_n(stamp_ns)
    fields: dict[str, Any] = {
        **header(sequence, stamp_ns), "handle_position_m": 0.01,
        "command_position_m": 0.01 + 0.002 * sin(stamp_ns * 1e-9),
        "predicted_n": force_n, "low_n": force_n - 0.02, "high_n": force_n + 0.03,
        "leading": "friction, recent", "zoh_n": 0.1, "rendered_n": 0.5 * force_n, "force_age_s": 0.15,
        "delay_s": 0.3, "answered_sequence": sequence - 300 if sequence > 300 else None, "limited": False,
        "energy_j": 0.004,
    }  # fmt: skip
    return HapticSample(**fields | changes)


def wave_n(stamp_ns: int) -> float:
    """The contact force when a command of that stamp is executed."""
    return 0.2 + 0.1 * sin(2.0 * stamp_ns * 1e-9)


def force(sequence: int, stamp_ns: int, answers: tuple[int, int] | None, **changes: object) -> ForceSample:
    """`answers`: sequence and stamp of the command."""
    fields: dict[str, Any] = {
        **header(sequence, stamp_ns), "position_m": 0.0099, "velocity_m_s": 0.0, "raw_counts": 1,
        "force_n": 0.0 if answers is None else wave_n(answers[1]), "valid": True,
        "answers_sequence": None if answers is None else answers[0],
        "answers_stamp_ns": None if answers is None else answers[1],
    }  # fmt: skip
    return ForceSample(**fields | changes)


def slave_state(stamp_ns: int = 0, **changes: object) -> SlaveState:
    fields: dict[str, Any] = {
        **header(1, stamp_ns), "state": "armed", "reason": "ramp done", "position_m": 0.01,
        "velocity_m_s": 0.0, "gripper": "closed", "stops": 0, "clock_offset_ns": None, "clock_bound_ns": None,
        "counters": {"refused_late": 7, "commands_superseded": 3},
    }  # fmt: skip
    return SlaveState.model_validate(fields | changes)


def master_state(stamp_ns: int = 0, **changes: object) -> MasterState:
    fields: dict[str, Any] = {
        **header(1, stamp_ns), "indication": "armed", "reason": "ramp done", "deadman": True,
        "clutched_s": 0.0, "clock_offset_ns": None, "clock_bound_ns": None,
        "counters": {"forces_reordered": 2},
    }  # fmt: skip
    return MasterState.model_validate(fields | changes)


def parameters(stamp_ns: int = 0, **changes: object) -> ModelParameters:
    fields: dict[str, Any] = {
        **header(1, stamp_ns),
        "names": ("mass_damper_spring.stiffness_n_m", "bias.force_n", "presliding_hysteresis.force_n"),
        "values": (12.0, 0.01, 0.08), "standard_deviations": (0.3, 0.02, 0.001),
        "identifiable": (), "valid": True, "samples": 900, "updates": 800, "resets": 0,
        "innovation_rms_n": 0.005,
    }  # fmt: skip
    return ModelParameters(**fields | changes)


def timing(**changes: object) -> LoopTiming:
    fields: dict[str, Any] = {
        **header(1, 0), "loop": "haptic", "ticks": 10_000, "missed": 2, "p50_us": 30.0, "p99_us": 200.0,
        "max_us": 900.0, "edges_us": (1.0, 10.0), "counts": (1, 2, 3), "scheduling": "other",
    }  # fmt: skip
    return LoopTiming(**fields | changes)


def limit(**changes: object) -> LimitEvent:
    fields: dict[str, Any] = {
        **header(1, 0), "rule": "velocity", "requested": 0.3, "applied": 0.2, "unit": "m/s", "count": 4,
    }  # fmt: skip
    return LimitEvent(**fields | changes)


def safety(**changes: object) -> SafetyEvent:
    fields: dict[str, Any] = {
        **header(1, 0), "before": "armed", "event": "watchdog", "after": "stopping", "reason": "no command",
    }  # fmt: skip
    return SafetyEvent.model_validate(fields | changes)


Spoken = tuple[Topic[Any], Message, int]


def talk(first: int, last: int, start_ns: int = 9 * S, delay_ms: int = 300) -> Iterator[Spoken]:
    """A cell at 1 kHz, from tick to tick: topic, message, when heard. Forces answer after `delay_ms`."""
    for tick in range(first, last):
        now_ns = start_ns + tick * MS
        yield HAPTICS, haptics(tick, now_ns), now_ns + 2 * MS
        sent = tick - delay_ms
        if sent >= 0:
            answered = (sent, start_ns + sent * MS)
            stamp_ns = answered[1] + delay_ms * MS // 2 + AHEAD_NS
            yield FORCE, force(tick, stamp_ns, answered), now_ns + 2 * MS
        if tick % 50 == 0:
            yield PARAMETERS, parameters(now_ns), now_ns + 2 * MS
            yield SLAVE_STATE, slave_state(now_ns), now_ns + 2 * MS
            yield MASTER_STATE, master_state(now_ns), now_ns + 2 * MS
        if tick % 1000 == 0:
            yield MASTER_TIMING, timing(), now_ns + 2 * MS
            yield LIMIT_EVENT, limit(), now_ns + 2 * MS


def hear(cell: CellView, spoken: Iterator[Spoken], axis: str = AXIS) -> int:
    """As from the network; when the last was heard."""
    heard_ns = 0
    for topic, message, heard_ns in spoken:
        cell.hear(topic.key(CELL, axis), encode(message), heard_ns)
    return heard_ns


def heard(seconds: float = 3.0) -> tuple[AxisView, int]:
    """An axis after so long, and the time."""
    cell = CellView()
    now_ns = hear(cell, talk(1, round(1000 * seconds)))
    return cell.axes[AXIS], now_ns
