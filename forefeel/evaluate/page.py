"""evaluation.html, and the table of an evaluation for the terminal."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from forefeel.common.error_size import Floats
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.events.text import quantity
from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import Evaluated
from forefeel.diagnosis.evaluation.methods import METHODS
from forefeel.diagnosis.evaluation.regimes import REGIMES, RegimeScore
from forefeel.report.svg_drawing import (
    BLACK,
    BLUE,
    ORANGE,
    Drawing,
    band,
    drawn,
    finish,
    limit_y,
    one_plot,
    plot,
    styled,
)
from forefeel.report.template import render
from forefeel.report.wording import DISCLAIMER, share
from forefeel.terminal import table

_WORST_S = 6.0  # drawn around the worst error
_TYPICAL_S = 10.0  # length of the typical stretch
_TRIM = 0.001  # share of a trace's highest and of its lowest values that may lie outside of the picture
_LIMITS = "Values far beyond the others are cut off at the edge of the picture."


def render_page(
    link: DelayedLink, rules: Sequence[str], recordings: Mapping[str, Evaluated], skipped: Mapping[str, str]
) -> str:
    """The evaluation with figures as one HTML file that needs nothing else."""
    return render(
        "evaluate/page.html.j2",
        link=link,
        rules=rules,
        recordings=recordings,
        skipped=skipped,
        methods=list(METHODS),
        best=best,
        ratio_to_zoh=ratio_to_zoh,
        drawings=drawings,
        regimes=REGIMES,
        regime_text=regime_text,
    )


@styled()
def drawings(stem: str, evaluated: Evaluated) -> list[Drawing]:
    """Around the worst error, a typical stretch, the error over time."""
    worst_s, typical_s = worst_stamp(evaluated), typical_start(evaluated)
    return [
        _forces(
            stem,
            evaluated,
            (worst_s - _WORST_S / 2, worst_s + _WORST_S / 2),
            "Around the worst error",
            f"The largest scored error of forefeel, at {worst_s:.2f} s. {_LIMITS}",
        ),
        _forces(
            stem,
            evaluated,
            (typical_s, typical_s + _TYPICAL_S),
            f"A typical {_TYPICAL_S:g} s",
            "The stretch whose rms error of forefeel is the median of all such stretches.",
        ),
        _errors(stem, evaluated),
    ]


def worst_stamp(evaluated: Evaluated) -> float:
    """When forefeel's scored error is largest, in s after the first stamp."""
    size = np.where(evaluated.prepared.rows, _squared_errors(evaluated), -1.0)
    return float(_time_s(evaluated)[int(np.argmax(size))])


def typical_start(evaluated: Evaluated) -> float:
    """Start of the stretch of 10 s, of those one after the other, with forefeel's median rms error."""
    time_s, rows = _time_s(evaluated), evaluated.prepared.rows
    squares = _squared_errors(evaluated)
    first_s = float(time_s[rows][0])
    stretch = np.floor((time_s[rows] - first_s) / _TYPICAL_S).astype(np.int64)
    known = np.unique(stretch)
    known = known[:-1] if len(known) > 1 else known  # the last one is cut short
    means = np.array([np.mean(squares[rows][stretch == number]) for number in known])
    middle = known[np.argsort(means)[(len(known) - 1) // 2]]
    return first_s + _TYPICAL_S * float(middle)


def _squared_errors(evaluated: Evaluated) -> Floats:
    with np.errstate(over="ignore", invalid="ignore"):
        squares = (evaluated.said_n["forefeel"] - evaluated.prepared.force_n) ** 2
    return np.nan_to_num(squares, nan=np.finfo(np.float64).max)


def _time_s(evaluated: Evaluated) -> Floats:
    time_s = evaluated.prepared.recording.time_s
    return np.asarray(time_s - time_s[0])


def _forces(
    stem: str, evaluated: Evaluated, span_s: tuple[float, float], title: str, caption: str
) -> Drawing:
    time_s = _time_s(evaluated)
    rows = (time_s >= span_s[0]) & (time_s <= span_s[1])
    zoh_n, said_n = evaluated.said_n["zoh"][rows], evaluated.said_n["forefeel"][rows]
    force_n, trace = evaluated.prepared.force_n[rows], evaluated.traces["forefeel"]
    figure, axes = one_plot(3.3)
    limit_y(axes, zoh_n, force_n, beside=said_n, trim=_TRIM)
    band(axes, time_s[rows], trace.low_n[rows], trace.high_n[rows], "95 % band", GAP_S)
    plot(axes, time_s[rows], zoh_n, ORANGE, "zero-order hold", gap_s=GAP_S)
    plot(axes, time_s[rows], force_n, BLACK, "measured", width=1.7, gap_s=GAP_S)
    plot(axes, time_s[rows], said_n, BLUE, "forefeel", gap_s=GAP_S)
    finish(axes, "time in s", "force in N")
    return drawn(figure, stem, title, caption)


def _errors(stem: str, evaluated: Evaluated) -> Drawing:
    rows, force_n = evaluated.prepared.rows, evaluated.prepared.force_n
    time_s = _time_s(evaluated)[rows]
    zoh_n, said_n = ((evaluated.said_n[name] - force_n)[rows] for name in ("zoh", "forefeel"))
    figure, axes = one_plot(3.0)
    limit_y(axes, zoh_n, beside=said_n, trim=_TRIM)
    plot(axes, time_s, zoh_n, ORANGE, "zero-order hold - measured", gap_s=GAP_S)
    plot(axes, time_s, said_n, BLUE, "forefeel - measured", gap_s=GAP_S)
    finish(axes, "time in s", "error in N")
    return drawn(figure, stem, "Error over time", f"All scored stamps. {_LIMITS}")


def ratio_to_zoh(evaluated: Evaluated, name: str) -> float | None:
    """rms over that of zoh; None when either is unknown, or zoh makes no error."""
    rms_n, zoh_n = evaluated.scores[name].size.rms_n, evaluated.scores["zoh"].size.rms_n
    return rms_n / zoh_n if rms_n is not None and zoh_n else None


def best(evaluated: Evaluated) -> str | None:
    known = {name: score.size.rms_n for name, score in evaluated.scores.items()}
    finite = {name: rms_n for name, rms_n in known.items() if rms_n is not None}
    return min(finite, key=lambda name: finite[name]) if finite else None


def in_words(
    link: DelayedLink, rules: Sequence[str], recordings: Mapping[str, Evaluated]
) -> Iterator[RenderableType]:
    yield _table(link, recordings)
    yield _regimes(recordings)
    for stem, evaluated in recordings.items():
        yield f"{stem}: {'; '.join(evaluated.notes)}"
    yield from ("", *rules, DISCLAIMER)


def _table(link: DelayedLink, recordings: Mapping[str, Evaluated]) -> Table:
    title = f"Error, rms and (its ratio to the zero-order hold), delay {link.delay_s:g} s; * best"
    numbers = (*METHODS, "95 % band")
    made = table("recording", *numbers, title=title, right=numbers)
    for stem, evaluated in recordings.items():
        made.add_row(Text(stem), *(_cell(evaluated, name) for name in METHODS), _coverage(evaluated))
    return made


def _regimes(recordings: Mapping[str, Evaluated]) -> Table:
    title = "forefeel by regime, rms and (its ratio to the zero-order hold), share of the scored samples"
    made = table("recording", *REGIMES, title=title, right=REGIMES)
    for stem, evaluated in recordings.items():
        made.add_row(Text(stem), *(Text(regime_text(evaluated.regimes[name])) for name in REGIMES))
    return made


def regime_text(score: RegimeScore) -> str:
    """rms of forefeel, its ratio to zoh, share of the samples; that there are none, or that it diverged."""
    if not score.share:
        return "no samples"
    if score.forefeel_rms_n is None:
        return f"diverged, {share(score.share)}"
    relative = "" if score.ratio is None else f" ({score.ratio:.3f})"
    return f"{quantity(score.forefeel_rms_n, 'N')}{relative}, {share(score.share)}"


def _cell(evaluated: Evaluated, name: str) -> Text:
    score = evaluated.scores[name]
    if score.diverged_at_s is not None:
        return Text(f"diverged at {score.diverged_at_s:.1f} s  ", style="red")
    text = quantity(score.size.rms_n, "N")
    relative = ratio_to_zoh(evaluated, name)
    if name != "zoh" and relative is not None:
        text += f" ({relative:.3f})"
    first = name == best(evaluated)
    return Text(f"{text} {'*' if first else ' '}", style="bold green" if first else "")


def _coverage(evaluated: Evaluated) -> Text:
    """How much of the force the band of forefeel holds."""
    return Text(share(evaluated.scores["forefeel"].band.coverage))
