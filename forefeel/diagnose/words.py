"""The short answer, for an engineer who has to decide what to do next."""

from common.recording.recording import Recording
from diagnosis.diagnose.prediction import Across
from diagnosis.diagnose.verdict import Cause, Diagnosis, Interval
from forefeel.report.text import DISCLAIMER
from forefeel.report.wording import quantity

_SAID = {
    "nothing_missing": "Nothing is missing: mass, damper and spring explain this down to its noise.",
    "unexplained": "Something is missing that no known cause explains. Nothing is named.",
    "not_separable": "Something is missing, and this motion can not tell which of several causes it is.",
}
_PLAIN = {
    "bias": "a constant offset of the load cell",
    "coulomb_friction": "dry friction",
    "stribeck_friction": "dry friction that is larger at low speed",
    "presliding_hysteresis": "friction that builds up after each reversal",
    "backlash": "play between stage and instrument",
    "stiffening": "a spring that stiffens with depth",
    "hunt_crossley_damping": "damping that grows with depth",
    "quadratic_drag": "drag with the square of speed",
    "asymmetric_damping": "damping that differs by direction",
    "stress_relaxation": "a force that fades during holds",
    "contact_loss": "no contact before a certain position",
    "position_dependent_friction": "friction that grows with inserted length",
    "stiffness_change": "the stiffness changes at an instant",
    "time_delay": "the force is stamped late",
    "sensor_lag": "the load cell is slow",
    "sensor_drift": "the load cell drifts",
    "sensor_saturation": "the load cell is at the end of its range",
    "sensor_quantisation": "the load cell has coarse steps",
    "sensor_spikes": "the load cell has isolated outliers",
    "pulsation": "a periodic force of its own, such as heart beat or breath",
    "mains_hum": "mains hum",
    "unmodelled_resonance": "a second mode: something flexible swings",
}


def answer(recording: Recording, diagnosis: Diagnosis, across: Across | None) -> list[str]:
    """A few lines; the last one before the files is the gain."""
    held = diagnosis.held_out
    lines = [
        f"{recording.name}: {len(recording)} samples, {recording.duration_s:.1f} s, "
        f"{recording.rate_hz:.4g} Hz"
        + (f"; {', '.join(flag.replace('_', ' ') for flag in diagnosis.flags)}" if diagnosis.flags else ""),
        f"Simulation  off by {quantity(held.rmse_before_n, 'N')} rms; "
        f"{quantity(diagnosis.noise_floor_n, 'N')} of it is noise",
        f"Verdict     {diagnosis.verdict}",
    ]
    lines += [f"Cause       {_cause(cause)}" for cause in diagnosis.causes]
    if diagnosis.verdict in _SAID:
        lines.append(f"            {_SAID[diagnosis.verdict]}")
    lines += [f"Rivals      {', '.join(group)}" for group in diagnosis.rivals]
    if diagnosis.suggested_motion:
        lines.append(f"Record next {diagnosis.suggested_motion}")
    if diagnosis.verdict == "cause_found":
        lines.append(
            f"Gain        {quantity(held.rmse_before_n, 'N')} -> {quantity(held.rmse_after_n, 'N')} "
            f"on held-out blocks ({100 * held.gain:.0f} %, "
            f"{100 * held.gain_low:.0f} to {100 * held.gain_high:.0f} %)"
        )
    if across is not None and diagnosis.verdict == "cause_found":
        lines.append(
            f"Predicted   300 ms ahead: {quantity(across.before_n, 'N')} -> "
            f"{quantity(across.after_n, 'N')} rms"
        )
    return [*lines, DISCLAIMER]


def one_line(diagnosis: Diagnosis) -> str:
    """For the summary of a folder."""
    names = [cause.name for cause in diagnosis.causes] or [" | ".join(group) for group in diagnosis.rivals]
    return f"{diagnosis.verdict}{': ' if names else ''}{', '.join(names)}"


def plain(name: str) -> str:
    """A cause in everyday words."""
    return _PLAIN.get(name, name)


def shown(name: str, interval: Interval) -> str:
    """A parameter with its interval, in the unit of its name."""
    return f"{name} {interval.value:.4g} ({interval.low:.4g} to {interval.high:.4g})"


def _cause(cause: Cause) -> str:
    parameters = "; ".join(shown(name, value) for name, value in cause.parameters.items())
    return f"{cause.name}: {plain(cause.name)}. {parameters}"
