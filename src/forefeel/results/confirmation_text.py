"""Result of a model on another recording, in words."""

from forefeel.common.events.console import printable
from forefeel.common.events.text import quantity
from forefeel.diagnosis.confirmation import Confirmation, Replay
from forefeel.diagnosis.verdict import ExpectedGain
from forefeel.results.verdict_text import gain_text

_CAUTIONS = {
    "easier": "that recording asks so little of the model that a wrong one would do as well there",
    "structure": "more than noise is left there: something else may be missing",
}


def confirmation_lines(replay: Replay) -> list[tuple[str, str]]:
    """Lines (label, text) on a confirmation: verdict and error, gain by the causes there, cautions; an empty
    label continues the line before. One line where the diagnosis has no model that could be confirmed.
    """
    c, diagnosis = replay.confirmation, replay.of
    name = printable(c.recording)
    if not diagnosis.has_a_model:
        return [("Not told", f"{name}: no cause was named that it could confirm")]
    off = f"off by {quantity(c.left_n, 'N')} rms, {c.ratio:.2f} times what is to be expected"
    label, text = {
        "confirmed": ("Confirmed", f"on {name}: {off}"),
        "not_confirmed": (
            "Not confirmed", f"on {name}: {off}; a name is wrong or missing, or the bench has changed"
        ),
        "not_told": (
            "Not told", f"on {name}: {off}, as the intervals of the parameters allow; record a richer motion"
        ),
    }[c.verdict]  # fmt: skip
    lines = [(label, text)]
    if c.gain is not None:
        lines.append(
            ("", f"error {gain_text(c.gain)} by the causes there{_beside(c, diagnosis.other_motion)}")
        )
    cautions = "; ".join(_CAUTIONS[caution] for caution in c.cautions)
    return [*lines, ("Caution", f"{name}: {cautions}")] if cautions else lines


def _beside(c: Confirmation, expected: ExpectedGain | None) -> str:
    """Text whether the gain is within the one expected elsewhere; empty where none was expected."""
    if expected is None or c.gain is None:
        return ""
    inside = expected.gain_low <= c.gain.gain <= expected.gain_high
    return ", as expected elsewhere" if inside else ", other than expected elsewhere"
