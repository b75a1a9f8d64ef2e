"""evaluation.html, and the tables of an evaluation for the terminal."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.events.text import quantity, shown_unit
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.delays import CLINICAL_DELAYS, CLINICAL_SOURCES
from forefeel.diagnosis.evaluation.evaluate import Evaluated
from forefeel.diagnosis.evaluation.methods import METHODS, Mask
from forefeel.diagnosis.evaluation.regimes import REGIMES, RegimeScore
from forefeel.diagnosis.evaluation.score import Score
from forefeel.report.drawing import DASHED, DOTTED, Figure, Layer, band, limits, line, panel, spec
from forefeel.report.template import render
from forefeel.report.wording import DISCLAIMER, offset_text, share
from forefeel.terminal import table

_TYPICAL_S = 10.0  # length of the typical stretch
_WORN: Mapping[str, tuple[str, str, Layer]] = {
    "zoh": ("held, late", "late", DASHED),
    "paper": ("paper", "soft", DOTTED),
    "mbk_bias": ("mbk_bias", "readback", DOTTED),
    "forefeel": ("predicted", "predicted", {}),
}
"""Name, colour and dashes of each method's line."""
_TRIM = 0.001  # share of a trace's highest and of its lowest values that may lie outside of the picture


def render_page(
    link: DelayedLink, rules: Sequence[str], recordings: Mapping[str, Evaluated], skipped: Mapping[str, str]
) -> str:
    """Text of evaluation.html: headline, rules, errors by method and regime, pictures, and what was skipped,
    with the reason; `recordings` and `skipped` by the file's stem.
    """
    return render(
        "evaluation/page.html.j2",
        link=link,
        rules=rules,
        recordings=recordings,
        skipped=skipped,
        headline=headline(link, recordings),
        ratio_to_zoh=ratio_to_zoh,
        size_text=size_text,
        regime_text=regime_text,
        figures=figures,
        delay_figure=delay_figure,
        offset_text=offset_text,
    )


def headline(link: DelayedLink, recordings: Mapping[str, Evaluated]) -> str:
    """One sentence with the least and greatest ratio of the prediction's rms error to that of the zero-order
    hold, over all recordings; or that none is known.
    """
    ratios = (ratio_to_zoh(evaluated.scores, "forefeel") for evaluated in recordings.values())
    known = sorted(ratio for ratio in ratios if ratio is not None)
    late = f"With forces that are {quantity(link.delay_s, 's')} late"
    if not known:
        return f"{late}, nothing can be compared: the prediction diverged, or the held force has no error."
    ends = dict.fromkeys(f"{ratio:.2g}" for ratio in (known[0], known[-1]))
    return f"{late}, the prediction has {' to '.join(ends)} of the error of the held force."


def figures(evaluated: Evaluated) -> tuple[Figure, Figure]:
    """Pictures of forces and errors: first of the stretch of 10 s with the median error of forefeel, without
    the shorter last stretch; second of all scored stamps.
    """
    time_s, rows = evaluated.prepared.recording.time_s, evaluated.prepared.rows
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (evaluated.predicted_n["forefeel"] - evaluated.prepared.force_n)[rows] ** 2
        stretch = ((time_s[rows] - time_s[rows][0]) / _TYPICAL_S).astype(np.int64)
        means = np.bincount(stretch, squares) / np.bincount(stretch)  # NaN, the last, within a gap
    means = means[:-1] if len(means) > 1 else means  # the last one is cut short
    order = np.argsort(means)[: np.count_nonzero(~np.isnan(means)) or 1]
    start_s = float(time_s[rows][0]) + _TYPICAL_S * float(order[(len(order) - 1) // 2])
    within = (time_s >= start_s) & (time_s <= start_s + _TYPICAL_S)
    caption = "The stretch with the median error. Below, predicted and held less measured force."
    far = "All scored stamps. Values far beyond the others are cut off at the edge of the picture."
    whole = _figure(evaluated, rows, "The whole recording", far)
    return _figure(evaluated, within, f"A typical {_TYPICAL_S:g} s", caption), whole


def _figure(evaluated: Evaluated, rows: Mask, title: str, caption: str) -> Figure:
    """Picture of the stamps in `rows` over s since the recording's start: above the measured, held and
    predicted force with its 95 % band, below the errors of the held and the predicted one. Extreme values are
    cut off.
    """
    stamps_s, force_n = evaluated.prepared.recording.time_s, evaluated.prepared.force_n[rows]
    time_s = stamps_s[rows] - stamps_s[0]
    held_n, predicted_n = evaluated.predicted_n["zoh"][rows], evaluated.predicted_n["forefeel"][rows]
    trace, panels = evaluated.traces["forefeel"], []
    shade = band("95 % band", "predicted", time_s, trace.low_n[rows], trace.high_n[rows], GAP_S)
    measured = line("measured", "measured", time_s, force_n, GAP_S, **DOTTED)
    for label, zero_n, more in ("force", 0.0 * force_n, [measured]), ("error", force_n, []):
        lines = [
            line("held, late", "late", time_s, held_n - zero_n, GAP_S, **DASHED),
            line("predicted", "predicted", time_s, predicted_n - zero_n, GAP_S),
        ]
        y = limits(held_n - zero_n, beside=predicted_n - zero_n, trim=_TRIM)
        title_n = f"{label}, {shown_unit('N')}"
        panels.append(panel(title_n, y, lines=lines + more, bands=[shade] if more else []))
    return Figure(title, caption, 440, (spec(panels, unit="s"),))


def delay_figure(evaluated: Evaluated) -> Figure:
    """Picture of the rms error of each method over the delay, with the delays that count at the patient;
    methods far worse than the late force leave the picture.
    """
    delays_ms = 1e3 * np.array(list(evaluated.by_delay))
    scored = evaluated.by_delay.values()
    sizes_n = {
        name: np.array([scores[name].size.rms_n for scores in scored], dtype=np.float64) for name in METHODS
    }
    y = limits(sizes_n["zoh"], sizes_n["forefeel"], beside=np.concatenate(list(sizes_n.values())), zero=True)
    lines = [
        line(label, colour, delays_ms, sizes_n[name], **more) for name, (label, colour, more) in _WORN.items()
    ]
    rules = [
        {"name": f"{1e3 * at_s:g} ms: {what}", "colour": "warn", "dash": [2, 4], "at": 1e3 * at_s}
        for at_s, what in CLINICAL_DELAYS
        if delays_ms[0] <= 1e3 * at_s <= delays_ms[-1]
    ]
    canvas = spec([panel(f"error, rms, {shown_unit('N')}", y, lines=lines, rules=rules)], label="delay, ms")
    caption = f"Upright: what was done or seen at such a round trip. {CLINICAL_SOURCES}."
    return Figure("Error over the delay", caption, 380, (canvas,))


def ratio_to_zoh(scores: Mapping[str, Score], name: str) -> float | None:
    """rms over that of zoh; None when either is unknown, or zoh makes no error."""
    rms_n, zoh_n = scores[name].size.rms_n, scores["zoh"].size.rms_n
    return rms_n / zoh_n if rms_n is not None and zoh_n else None


def size_text(scores: Mapping[str, Score], name: str) -> str:
    """rms of a method and its ratio to zoh, or when it diverged."""
    score, relative = scores[name], ratio_to_zoh(scores, name)
    if score.diverged_at_s is not None:
        return f"diverged at {score.diverged_at_s:.1f} s"
    text = quantity(score.size.rms_n, "N")
    return text if name == "zoh" or relative is None else f"{text} ({relative:.3f})"


def regime_text(score: RegimeScore) -> str:
    """Text of a regime: rms error of forefeel, its ratio to zoh where known, share of the scored samples; or
    that there are no samples, or that it diverged.
    """
    if not score.share:
        return "no samples"
    if score.forefeel_rms_n is None:
        return f"diverged, {share(score.share)}"
    relative = "" if score.ratio is None else f" ({score.ratio:.3f})"
    return f"{quantity(score.forefeel_rms_n, 'N')}{relative}, {share(score.share)}"


def in_words(link: DelayedLink, recordings: Mapping[str, Evaluated]) -> Iterator[RenderableType]:
    """Yields what the terminal shows: tables by method, by regime and, for several delays, by delay, the
    notes of each recording, headline and disclaimer.
    """
    numbers = (*METHODS, "in the 95 % band", "forefeel's time offset")
    title = f"Error, rms and (its ratio to the zero-order hold), delay {link.delay_s:g} s"
    errors = table("recording", *numbers, title=title, right=numbers)
    title = "forefeel by regime, rms and (its ratio to the zero-order hold), share of the scored samples"
    parts = table("recording", *REGIMES, title=title, right=REGIMES)
    delays = [f"{1e3 * delay_s:g} ms" for delay_s in next(iter(recordings.values())).by_delay]
    title = "forefeel over the delay, rms and (its ratio to the zero-order hold)"
    over_delay = table("recording", *delays, title=title, right=delays)
    for stem, evaluated in recordings.items():
        score = evaluated.scores["forefeel"]
        more = share(score.band.coverage), offset_text(score.offset_s)
        errors.add_row(Text(stem), *(size_text(evaluated.scores, name) for name in METHODS), *more)
        parts.add_row(Text(stem), *(regime_text(evaluated.regimes[name]) for name in REGIMES))
        sizes = [size_text(scores, "forefeel") for scores in evaluated.by_delay.values()]
        over_delay.add_row(Text(stem), *sizes)
    yield from (errors, parts, over_delay) if len(delays) > 1 else (errors, parts)
    yield from (f"{stem}: {'; '.join(evaluated.notes)}" for stem, evaluated in recordings.items())
    yield from ("", headline(link, recordings), DISCLAIMER)
