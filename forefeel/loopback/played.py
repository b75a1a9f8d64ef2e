"""The settings of both ends for a measured motion that is played, with its force where it has one."""

from typing import Any, Literal

import numpy as np

from forefeel.common.recording.recording import Array, Recording

GAP_S = 0.1
"""A longer gap between samples is not interpolated."""
HAND_MAX_N = 4.0
"""What the hand is given at most."""
# m/s, fastest approach to the recording's start; chosen, not measured: slower takes longer
_APPROACH_M_S = 0.03
Axis = dict[str, Any]


def play(recording: Recording, source: Axis, slave_axis: Axis, master_axis: Axis) -> tuple[str, ...]:
    """Limits and scale from the recording; the recorded force in place of the simulated one where there is
    one. Returns what to tell the user. `source`: the recording as settings of a device name it.
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
        "acceleration_limit_m_s2": 2 * limits["max_acceleration_m_s2"],
        "encoder_step_m": min(1e-6, span * 1e-5),
    }
    master_axis["prediction"] = {"typical_stroke_m": span}
    master_axis["handle"] = {
        "driver": "recording",
        "gap_s": GAP_S,
        "approach_m_s": _approach(limits),
        **source,
    }
    notes = _notes(recording, limits)
    if recording.force_n is None:
        return (*notes, "no force column: the motion drives the simulated vessel")
    return (*notes, *_play_force(recording, recording.force_n, source, slave_axis, master_axis))


def _play_force(
    recording: Recording, force_n: Array, source: Axis, slave_axis: Axis, master_axis: Axis
) -> list[str]:
    """The load cell answers with the recorded force; what the hand feels of it stays within the hand's."""
    sign = resisting_sign(recording)
    slave_axis["load_cell"] = {"driver": "recorded", "force_sign": sign, **source}
    slave_axis["gate"]["force_timeout_s"] = None
    strongest_n, spread_n = float(np.max(np.abs(force_n))), float(np.std(force_n))
    master_axis["prediction"]["noise_floor_n"] = max(0.01 * spread_n, 1e-6)
    scale = min(1.0, HAND_MAX_N / strongest_n) if strongest_n > 0 else 1.0
    master_axis["rendering"] = {"force_scale": scale, "max_force_n": HAND_MAX_N}
    notes = [f"force scale to the hand {scale:.3g}"]
    if sign < 0:
        notes.append(
            "force sign turned: as recorded the contact would give energy; here positive resists insertion"
        )
    return notes


def resisting_sign(recording: Recording) -> Literal[1, -1]:
    """1 where the recorded force resists insertion, -1 where it is the reaction to that.

    A contact is passive: over the whole recording it absorbs energy, the integral of F dx is positive.
    """
    assert recording.force_n is not None
    force_n, work_j = recording.force_n - recording.force_n.mean(), 0.0
    for piece in recording.segments(GAP_S):
        between = 0.5 * (force_n[piece][1:] + force_n[piece][:-1])
        work_j += float(between @ np.diff(recording.position_m[piece]))
    return -1 if work_j < 0 else 1


def recording_limits(recording: Recording, world_max_n: float) -> dict[str, Any]:
    """Limits that let the recorded motion through: range, speed, steps of speed, force, with margins.

    `world_max_n`: the force limit where no force was recorded.
    """
    low, high = float(recording.position_m.min()), float(recording.position_m.max())
    margin = max(0.05 * (high - low), 1e-5)
    speed, step = 0.0, 0.0
    for piece in recording.segments(GAP_S):
        velocity = np.diff(recording.position_m[piece]) / np.diff(recording.time_s[piece])
        speed = max(speed, float(np.max(np.abs(velocity), initial=0.0)))
        step = max(step, float(np.max(np.abs(np.diff(velocity)), initial=0.0)))
    forces_n = recording.force_n
    strongest_n = None if forces_n is None else float(np.max(np.abs(forces_n)))
    return {
        "workspace_m": (low - margin, high + margin),
        "max_velocity_m_s": _round_up(max(1.5 * speed, 0.005)),
        "max_acceleration_m_s2": _round_up(max(1.5 * step / 1e-3, 1.0)),
        "max_force_n": world_max_n if strongest_n is None else _round_up(max(1.2 * strongest_n, 0.01)),
    }


def _approach(limits: dict[str, Any]) -> float:
    return min(_APPROACH_M_S, float(limits["max_velocity_m_s"]) / 2)


def _round_up(value: float) -> float:
    """To two significant digits, upwards."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / unit) * unit:.6g}")


def _notes(recording: Recording, limits: dict[str, Any]) -> tuple[str, ...]:
    low, high = limits["workspace_m"]
    pieces = len(recording.segments(GAP_S))
    return (
        f"recording {recording.name}: {len(recording.time_s)} samples, {recording.duration_s:.1f} s, "
        f"{pieces} piece{'s' if pieces > 1 else ''} without a gap over {GAP_S:g} s",
        f"limits from it: {low * 1e3:.3f} to {high * 1e3:.3f} mm, {limits['max_velocity_m_s'] * 1e3:g} mm/s, "
        f"{limits['max_acceleration_m_s2']:g} m/s2, {limits['max_force_n']:g} N",
    )
