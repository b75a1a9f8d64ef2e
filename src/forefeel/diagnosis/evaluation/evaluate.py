"""Evaluation of one recording: notes on sampling, replay through every method, scores, evaluation.json."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import isfinite

import numpy as np

from forefeel.common.causes.model import ContactModel
from forefeel.common.error_size import Floats
from forefeel.common.errors import ConfigurationError, RecordingError
from forefeel.common.estimation.state_filter import GAP_S
from forefeel.common.recording.recording import Recording
from forefeel.common.time_offset import LONGEST_OFFSET_S
from forefeel.diagnosis.evaluation.arrivals import Arrivals, DelayedLink, arrivals
from forefeel.diagnosis.evaluation.methods import METHODS, Mask, MethodTrace, ZeroOrderHold, replay
from forefeel.diagnosis.evaluation.regimes import RULE, RegimeScore, by_regime, regimes
from forefeel.diagnosis.evaluation.score import (
    RUNAWAY,
    SETTLING_S,
    Score,
    completed,
    score,
    scored_stamps,
)


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A recording that can be evaluated. `arrivals`: its late forces, `delay_s` after their motion; `zoh`:
    those of the zero-order hold; `rows`: the stamps that are scored.
    """

    recording: Recording
    delay_s: float
    force_n: Floats
    arrivals: Arrivals
    zoh: MethodTrace
    rows: Mask


@dataclass(frozen=True, slots=True, eq=False)
class Evaluated:
    """Scores and predictions by method, zoh among them; `predicted_n` is zoh's where a method has none.
    `regimes`: forefeel beside zoh in the parts of the motion, by their names. `by_delay`: scores at each
    delay in s that was asked for, increasing, this one among them.
    """

    prepared: Prepared
    notes: tuple[str, ...]
    scores: Mapping[str, Score]
    predicted_n: Mapping[str, Floats]
    traces: Mapping[str, MethodTrace]
    regimes: Mapping[str, RegimeScore]
    by_delay: Mapping[float, Mapping[str, Score]]


def prepare(recording: Recording, link: DelayedLink, model: ContactModel | None = None) -> Prepared:
    """Computes the arrivals of a recording's forces, replays the zero-order hold, and finds the stamps to
    score. `model`: checked only for the columns that it follows.

    Raises:
        RecordingError: no force, shorter than 3 s and the delay, no force that arrives in time, or without a
            column that the model follows.
    """
    there = {column.name for column in recording.further}
    if missing := [name for name in (model.columns if model else ()) if name not in there]:
        raise RecordingError(
            f"{recording.source}: no column {missing[0]!r}, expected the one that the model follows"
        )
    if recording.force_n is None:
        raise RecordingError(f"{recording.source}: no force, expected a column with the measured force")
    needed_s = SETTLING_S + link.delay_s
    if recording.duration_s < needed_s:
        raise RecordingError(
            f"{recording.source}: {recording.duration_s:.3g} s long, expected at least {needed_s:g} s "
            f"({SETTLING_S:g} s and the delay)"
        )
    late = arrivals(recording.time_s, link)
    zoh = replay(recording, late, ZeroOrderHold())
    rows = scored_stamps(recording.time_s, link.delay_s, zoh)
    if not rows.any():
        raise RecordingError(
            f"{recording.source}: no force arrives before the end, expected less delay or loss"
        )
    return Prepared(recording, link.delay_s, recording.force_n, late, zoh, rows)


def evaluate(
    prepared: Prepared,
    model: ContactModel | None,
    progress: Callable[[str], None] = lambda name: None,
    links: Sequence[DelayedLink] = (),
    longest: Prepared | None = None,
) -> Evaluated:
    """Replays a recording through every method, each from a cold start, and scores them; forefeel and zoh
    also by regime of the motion.

    Args:
        prepared: see `prepare`.
        model: of a model.yaml, for forefeel; None: its own.
        progress: called with the name of each method before it starts.
        links: further links over which the methods are scored; one with the delay of `prepared` is skipped.
        longest: the recording already prepared for one of `links`, so that it is not prepared again.

    Raises:
        RecordingError: the recording can not be prepared for one of the links.
    """
    recording, force_n, zoh = prepared.recording, prepared.force_n, prepared.zoh
    traces: dict[str, MethodTrace] = {}
    for name, make in METHODS.items():
        progress(name)
        traces[name] = zoh if name == "zoh" else replay(recording, prepared.arrivals, make(model))
    scores = {
        name: score(recording.time_s, force_n, trace, zoh, prepared.rows) for name, trace in traces.items()
    }
    predicted_n = {name: completed(trace, zoh) for name, trace in traces.items()}
    forefeel_n = predicted_n["forefeel"] if scores["forefeel"].diverged_at_s is None else None
    parts = by_regime(regimes(recording), prepared.rows, force_n, predicted_n["zoh"], forefeel_n)
    by_delay: dict[float, Mapping[str, Score]] = {prepared.delay_s: scores}
    for link in links:
        if link.delay_s != prepared.delay_s:
            late = longest
            if late is None or late.delay_s != link.delay_s:
                late = prepare(recording, link, model)
            by_delay[link.delay_s] = evaluate(late, model, progress).scores
    ordered = dict(sorted(by_delay.items()))
    return Evaluated(prepared, _notes(prepared), scores, predicted_n, traces, parts, ordered)


def _notes(prepared: Prepared) -> tuple[str, ...]:
    """Sentences on the sampling, the gaps, and the number of samples that are scored."""
    rows = prepared.rows
    start_s = float(prepared.recording.time_s[np.flatnonzero(rows)[0]] - prepared.recording.time_s[0])
    return (*notes(prepared.recording), f"{np.count_nonzero(rows)} samples scored, from {start_s:.3f} s on")


def rules(link: DelayedLink, model: ContactModel | None) -> tuple[str, ...]:
    """Sentences that state the rules of the comparison: what is known when over the link, what is scored and
    how, and the settings of the methods. `model` None: forefeel uses its own.
    """
    return (
        "At a stamp t a method knows its own motion up to t and the forces that have arrived: "
        + (
            f"those stamped <= t - {link.delay_s:g} s."
            if not link.jitter_s
            else f"{link.delay_s:g} s late, earlier or later by up to {link.jitter_s:g} s each, in any order."
        )
        + (f" {100 * link.loss:.3g} % of them are lost." if link.loss else "")
        + (f" Seed {link.seed}." if link.jitter_s or link.loss else ""),
        "zoh, the zero-order hold, is the newest force by stamp among those that have arrived.",
        f"Scored at the recording's own stamps, against the force as recorded, from {SETTLING_S:g} s + delay "
        "after the first stamp on.",
        "Every recording is a cold start with the same settings; nothing is keyed to a file, a method is not "
        "told the delay.",
        f"Derivatives and filters are causal; a gap over {GAP_S:g} s is never interpolated across.",
        "Where a method has no prediction yet the zero-order hold counts. One that is not finite, or beyond "
        f"{RUNAWAY:g} times the largest force of the recording, has diverged: no rms.",
        "time offset: the shift at which the prediction correlates best with the force, above 0 where it is "
        f"late; none where that is beyond {LONGEST_OFFSET_S:g} s.",
        RULE,
        "paper: lambda 0.96 per sample, P symmetrised, each force paired with the motion of its own stamp. "
        f"forefeel: {'its own model' if model is None else f'model {model.name!r}'}.",
    )


def checked_model(model: ContactModel, source: str) -> ContactModel:
    """The model, if it holds something to identify.

    Raises:
        ConfigurationError: no linear parameter.
    """
    if not model.runtime().linear_names:
        raise ConfigurationError(f"{source}: no linear parameter; expected one to identify")
    return model


SCHEMA = "forefeel.evaluation/1"
_WITH_BAND = "forefeel"


def to_json(
    link: DelayedLink, rules: Sequence[str], recordings: Mapping[str, Evaluated], skipped: Mapping[str, str]
) -> str:
    """Text of evaluation.json: the link, the rules, the evaluated recordings by stem, and `skipped`, the
    reason by stem. Writes no file; raises ValueError for a number that is not finite.
    """
    document = {
        "schema": SCHEMA,
        "delay_s": link.delay_s,
        "jitter_s": link.jitter_s,
        "loss": link.loss,
        "seed": link.seed,
        "rules": list(rules),
        "recordings": {stem: _recording(evaluated) for stem, evaluated in recordings.items()},
        "skipped": dict(skipped),
    }
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def _recording(evaluated: Evaluated) -> dict[str, object]:
    """Entry of a recording in evaluation.json: sampling, notes, and scores by method, regime and delay."""
    recording = evaluated.prepared.recording
    return {
        "samples": len(recording),
        "duration_s": recording.duration_s,
        "rate_hz": recording.rate_hz,
        "gaps": len(recording.segments()) - 1,
        "notes": list(evaluated.notes),
        "methods": {name: _method(name, score) for name, score in evaluated.scores.items()},
        "regimes": {name: asdict(score) for name, score in evaluated.regimes.items()},
        "by_delay": [
            {"delay_s": delay_s, "rms_n": {name: score.size.rms_n for name, score in scores.items()}}
            for delay_s, scores in evaluated.by_delay.items()
        ],
    }


def _method(name: str, score: Score) -> dict[str, object]:
    """Entry of a method in evaluation.json: error, time offset, and `diverged_at_s` where it diverged.
    The band, and the expert that led, are forefeel's alone; a width that is not finite becomes None.
    """
    size = score.size
    fields: dict[str, object] = {"rms_n": size.rms_n, "p95_n": size.p95_n, "max_n": size.max_n}
    fields["offset_s"] = score.offset_s
    if score.diverged_at_s is not None:
        fields["diverged_at_s"] = score.diverged_at_s
    if name == _WITH_BAND:
        width_n = score.band.width_n
        fields["coverage_95"] = score.band.coverage
        fields["band_width_n"] = width_n if width_n is not None and isfinite(width_n) else None
        fields["leading_expert"] = score.band.leading
    return fields


_SHOWN_GAPS = 5  # gaps that are listed


def notes(recording: Recording) -> tuple[str, ...]:
    """Sentences on the sampling and, if there are any, on the gaps."""
    return _sampling(recording), *_gaps(recording)


def _sampling(recording: Recording) -> str:
    """Sentence on the rate, and on the spread of the periods where it is 1 % of the median or more; another
    one where no two samples are within 0.1 s. Intervals across gaps do not count.
    """
    period_ms = 1e3 * np.concatenate([np.diff(recording.time_s[piece]) for piece in recording.segments()])
    if not len(period_ms):
        return (
            f"no two samples within {GAP_S:g} s: no motion between samples is known, so expect the "
            f"zero-order hold ({recording.rate_hz:.3g} Hz)"
        )
    low, middle, high = np.quantile(period_ms, (0.01, 0.5, 0.99)).tolist()
    spread = (high - low) / middle
    if spread < 0.01:
        return f"sampled uniformly at {recording.rate_hz:.4g} Hz"
    return (
        f"not sampled uniformly: {recording.rate_hz:.4g} Hz in the median, period {low:.3g} to {high:.3g} ms "
        f"(1 % to 99 %), at most {period_ms.max():.3g} ms; taken as it is"
    )


def _gaps(recording: Recording) -> list[str]:
    """One sentence that counts the gaps and lists the first five; none without gaps."""
    pieces, time_s = recording.segments(), recording.time_s
    gaps = [(time_s[a.stop - 1], time_s[b.start]) for a, b in pairwise(pieces)]
    if not gaps:
        return []
    shown = ", ".join(
        f"{end - start:.2f} s at {start - time_s[0]:.2f} s" for start, end in gaps[:_SHOWN_GAPS]
    )
    more = f" and {len(gaps) - _SHOWN_GAPS} more" if len(gaps) > _SHOWN_GAPS else ""
    plural = "gap" if len(gaps) == 1 else "gaps"
    return [f"{len(gaps)} {plural} over {GAP_S:g} s, not bridged: {shown}{more}"]
