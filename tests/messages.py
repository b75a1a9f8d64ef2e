"""Messages with usual values, of which a test changes what it is about."""

from math import sin
from typing import Any, TypeVar

from forefeel.common.messages import ForceSample, HapticSample, Message
from forefeel.common.settings import AxisLimits, settings_hash, shared_text
from forefeel.common.topics import FORCE, HAPTICS, Topic

M = TypeVar("M", bound=Message)
SESSION = 77
SHARED = shared_text("cell", "insertion", AxisLimits())
"""Settings that both ends compare, of a cell and an axis without settings of their own."""

_HANDSHAKE = {
    "instance_id": 1,
    "software": "forefeel",
    "settings_hash": settings_hash(SHARED),
    "settings": SHARED,
}
_LIMIT = {"rule": "velocity", "requested": 0.3, "applied": 0.2, "unit": "m/s", "count": 4}
_TIMING = {
    "loop": "haptic", "ticks": 10_000, "missed": 2, "p50_us": 30.0, "p99_us": 200.0, "max_us": 900.0,
    "edges_us": (1.0, 10.0), "counts": (1, 2, 3), "scheduling": "other",
}  # fmt: skip
_USUAL: dict[str, dict[str, Any]] = {
    "master/command": {"position_m": 0.0, "velocity_m_s": 0.0, "deadman": True},
    "slave/force": {
        "position_m": 0.0099, "velocity_m_s": 0.0, "force_n": 0.0, "raw_counts": 1, "valid": True,
        "answers_sequence": None, "answers_stamp_ns": None,
    },
    "master/haptics": {
        "handle_position_m": 0.01, "leading": "friction, recent", "zoh_n": 0.1, "force_age_s": 0.15,
        "delay_s": 0.3, "limited": False, "energy_j": 0.004,
    },
    "slave/state": {
        "state": "armed", "reason": "ramp done", "position_m": 0.01, "velocity_m_s": 0.0, "gripper": "closed",
        "stops": 0, "clock_offset_ns": None, "clock_bound_ns": None,
        "counters": {"refused_late": 7, "commands_superseded": 3},
    },
    "master/state": {
        "indication": "armed", "reason": "ramp done", "deadman": True, "clutched_s": 0.0,
        "clock_offset_ns": None, "clock_bound_ns": None, "counters": {"forces_reordered": 2},
    },
    "master/parameters": {
        "names": ("mass_damper_spring.stiffness_n_m", "bias.force_n", "presliding_hysteresis.force_n"),
        "values": (12.0, 0.01, 0.08), "standard_deviations": (0.3, 0.02, 0.001), "identifiable": (),
        "valid": True, "samples": 900, "updates": 800, "resets": 0, "innovation_rms_n": 0.005,
    },
    "master/handshake": {"role": "master", **_HANDSHAKE},
    "slave/handshake": {"role": "slave", **_HANDSHAKE},
    "slave/limit": _LIMIT,
    "slave/safety": {"before": "armed", "event": "watchdog", "after": "stopping", "reason": "no command"},
    "any/estop": {"source": "nurse", "reason": "pressed"},
    "master/timing": _TIMING,
    "slave/timing": _TIMING,
    "slave/shape": {"x_m": (0.0, 0.01, 0.02), "y_m": (0.0, 0.0, 0.003), "z_m": (0.0, 0.0, 0.001)},
    "master/impairment": {"link": "inbound", "first_index": 0},
    "slave/impairment": {"link": "inbound", "first_index": 0},
}  # fmt: skip


def usual(topic: Topic[M], **changes: Any) -> M:  # noqa: ANN401 - any field
    """A message of the topic: number 1 of session 77, stamp 0, usual values, but for `changes`."""
    fields = {"session_id": SESSION, "sequence": 1, "stamp_ns": 0, **_USUAL.get(topic.name, {})}
    return topic.message.model_validate(fields | changes)


def wave_n(stamp_ns: int) -> float:
    """Contact force when a command of that stamp is executed."""
    return 0.2 + 0.1 * sin(2.0 * stamp_ns * 1e-9)


def haptics(sequence: int, stamp_ns: int, **changes: Any) -> HapticSample:  # noqa: ANN401 - any field
    """A sample that predicts the wave, answered after 300 samples."""
    force_n = wave_n(stamp_ns)
    fields: dict[str, Any] = {
        "sequence": sequence, "stamp_ns": stamp_ns, "predicted_n": force_n, "low_n": force_n - 0.02,
        "high_n": force_n + 0.03, "rendered_n": 0.5 * force_n,
        "command_position_m": 0.01 + 0.002 * sin(stamp_ns * 1e-9),
        "answered_sequence": sequence - 300 if sequence > 300 else None,
    }  # fmt: skip
    return usual(HAPTICS, **fields | changes)


def force(
    sequence: int,
    stamp_ns: int,
    answers: tuple[int, int] | None = None,
    **changes: Any,  # noqa: ANN401
) -> ForceSample:
    """A sample of the wave; `answers`: sequence and stamp of the command."""
    fields: dict[str, Any] = {"sequence": sequence, "stamp_ns": stamp_ns}
    if answers is not None:
        number, sent_ns = answers
        fields |= {"answers_sequence": number, "answers_stamp_ns": sent_ns, "force_n": wave_n(sent_ns)}
    return usual(FORCE, **fields | changes)
