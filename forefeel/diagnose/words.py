"""The answer in plain words, for an engineer who has to decide what to do next."""

from forefeel.common.events.text import quantity
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.prediction import Across
from forefeel.diagnosis.diagnose.verdict import Cause, Diagnosis, HeldOut
from forefeel.report.wording import DISCLAIMER, shown

PLAIN = {
    "bias": "a constant offset of the load cell",
    "coulomb_friction": "dry friction",
    "stribeck_friction": "dry friction that is larger at low speed",
    "presliding_hysteresis": "friction that builds up over a distance after each reversal",
    "backlash": "play between stage and instrument",
    "stiffening": "a spring whose stiffness changes with depth",
    "hunt_crossley_damping": "damping that grows with depth",
    "quadratic_drag": "drag with the square of the speed",
    "asymmetric_damping": "damping that differs by direction",
    "stress_relaxation": "a force that fades while the instrument is held",
    "contact_loss": "contact that begins at a certain position only",
    "position_dependent_friction": "friction that grows with the inserted length",
    "stiffness_change": "a stiffness that changes at an instant",
    "time_delay": "a force that is stamped late against the motion",
    "sensor_lag": "a load cell that follows slowly",
    "sensor_drift": "a drift of the load cell",
    "sensor_saturation": "the end of the load cell's range",
    "sensor_quantisation": "coarse steps of the load cell",
    "sensor_spikes": "isolated outliers of the load cell",
    "pulsation": "a periodic force of its own, such as heart beat or breath",
    "mains_hum": "hum of the mains",
    "unmodelled_resonance": "something flexible that swings: a second mode",
}
FLAGS = {
    "motion_driven_by_force": "the motion answers the force, so trust mass, damping, delay and lag less",
    "non_uniform": "the samples are unevenly spaced, so fast effects are less certain",
    "gaps": "the recording has gaps; nothing was assumed about what happened in them",
    "clipped": "where the force stood at the end of its range it was left out",
    "short": "under 10 s, so what is slow (relaxation, drift, breath) can hardly be told",
    "force_is_the_reaction": "a positive force pushes along the motion here; signs were turned",
}
_NOTHING = "Nothing is missing: mass, damper and spring explain the force down to its noise."
_UNEXPLAINED = (
    "Something is missing that none of the known causes explains. Nothing is named: "
    "the nearest name would mislead."
)
_RIVALS = "Something is missing, and this motion can not tell which of several causes it is:"

_LEFT_OUT = "The simulation leaves out, the largest first:"
_FEW = 3
"""So many rivals fit into a sentence."""


def plain(name: str) -> str:
    """A cause in everyday words."""
    return PLAIN.get(name, name.replace("_", " "))


def caution(flag: str) -> str:
    """What a flag means for the trust."""
    return FLAGS.get(flag, flag.replace("_", " "))


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    if diagnosis.verdict == "cause_found":
        names = [plain(cause.name) for cause in diagnosis.causes]
        return f"The simulation leaves out {_listed(names)}."
    if diagnosis.verdict == "not_separable":
        if sum(map(len, diagnosis.rivals)) > _FEW:
            return f"{_RIVALS[:-1]}."
        groups = "; ".join(_listed([plain(name) for name in group], "or") for group in diagnosis.rivals)
        return f"{_RIVALS} {groups}."
    return _NOTHING if diagnosis.verdict == "nothing_missing" else _UNEXPLAINED


def on_readings(diagnosis: Diagnosis) -> bool:
    """Whether all that was named is seen on the readings, and was taken out before models were compared."""
    return bool(diagnosis.causes) and not any(
        cause.evidence.likelihood or cause.evidence.gain for cause in diagnosis.causes
    )


def gain_text(held: HeldOut) -> str:
    """The gain on held-out blocks with its interval: less, or more, error."""
    word = "less" if held.gain >= 0.0 else "more"
    ends = sorted(100.0 * (end if held.gain >= 0.0 else -end) for end in (held.gain_low, held.gain_high))
    return f"{abs(100.0 * held.gain):.0f} % {word} ({ends[0]:.0f} to {ends[1]:.0f} %)"


def answer(
    recording: Recording, diagnosis: Diagnosis, across: Across | None, given: str | None = None
) -> list[str]:
    """A few lines for the terminal, the last one says what this is not. `given`: name of the simulation."""
    said = _LEFT_OUT if diagnosis.causes else _RIVALS if diagnosis.rivals else headline(diagnosis)
    lines = [
        f"{_printable(recording.name)}: {len(recording)} samples, {recording.duration_s:.1f} s, "
        f"{recording.rate_hz:.4g} Hz",
        f"Verdict     {diagnosis.verdict}. {said}",
    ]
    for group in diagnosis.rivals:
        lines += [f"{'Rivals' if i == 0 else '':<12}{name}: {plain(name)}" for i, name in enumerate(group)]
    if diagnosis.suggested_motion:
        lines.append(f"Record next {diagnosis.suggested_motion}")
    lines.append(
        f"Simulation  {'' if given is None else f'{given!r} is '}off by "
        f"{quantity(diagnosis.baseline.rmse_n, 'N')} rms; noise is {quantity(diagnosis.noise_floor_n, 'N')}"
    )
    for cause in diagnosis.causes:
        lines += _cause(cause)
    if diagnosis.verdict == "cause_found":
        lines += [_extended(diagnosis, given), *_predicted(diagnosis, across)]
    lines += [f"Caution     {caution(flag)}" for flag in diagnosis.flags]
    return [*lines, DISCLAIMER]


def named(diagnosis: Diagnosis) -> str:
    """For the summary of a folder."""
    names = [cause.name for cause in diagnosis.causes] or [" | ".join(group) for group in diagnosis.rivals]
    return f"{diagnosis.verdict}{': ' if names else ''}{', '.join(names)}"


def _cause(cause: Cause) -> list[str]:
    parameters = "; ".join(str(shown(name, value)) for name, value in cause.parameters.items())
    return [
        f"Cause       {cause.name}: {parameters}",
        f"            {plain(cause.name)}, {quantity(cause.explained_n, 'N')} rms of the force",
    ]


def _extended(diagnosis: Diagnosis, given: str | None) -> str:
    held = diagnosis.held_out
    if on_readings(diagnosis):
        return "Extended    the readings were freed of it before the rest was compared"
    return (
        f"Extended    off by {quantity(held.rmse_after_n, 'N')} rms on stretches it was not fitted to, "
        f"{gain_text(held)}{'' if given is None else ' than a fitted mass, damper, spring'}"
    )


def _predicted(diagnosis: Diagnosis, across: Across | None) -> list[str]:
    lines = []
    if across is not None:
        lines.append(
            f"Predicted   {1e3 * across.delay_s:.0f} ms ahead, rms: {quantity(across.before_n, 'N')} before, "
            f"{quantity(across.after_n, 'N')} extended, {quantity(across.zoh_n, 'N')} by a zero-order hold"
        )
    before, after = diagnosis.forward_rmse.get("before_m"), diagnosis.forward_rmse.get("after_m")
    if before is not None and after is not None:
        lines.append(
            f"Forward     position from the force, rms: {quantity(before, 'm')} before, "
            f"{quantity(after, 'm')} extended"
        )
    return lines


def _listed(names: list[str], word: str = "and") -> str:
    """`a, b and c`."""
    return f" {word} ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def _printable(text: str) -> str:
    """Names of files may hold anything."""
    return "".join(c if c.isprintable() else "?" for c in text)
