"""evaluation.json."""

import json
from collections.abc import Mapping, Sequence
from math import isfinite

from forefeel.diagnosis.evaluation.arrivals import DelayedLink
from forefeel.diagnosis.evaluation.evaluate import Evaluated
from forefeel.diagnosis.evaluation.score import Score

SCHEMA = "forefeel.evaluation/1"
_WITH_BAND = "forefeel"


def to_json(
    link: DelayedLink, rules: Sequence[str], recordings: Mapping[str, Evaluated], skipped: Mapping[str, str]
) -> str:
    """The text of evaluation.json; recordings and skipped files by their stem."""
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
    recording = evaluated.prepared.recording
    return {
        "samples": len(recording),
        "duration_s": recording.duration_s,
        "rate_hz": recording.rate_hz,
        "gaps": evaluated.gaps,
        "notes": list(evaluated.notes),
        "methods": {name: _method(name, score) for name, score in evaluated.scores.items()},
    }


def _method(name: str, score: Score) -> dict[str, object]:
    fields: dict[str, object] = {
        "rms_n": score.size.rms_n,
        "p95_n": score.size.p95_n,
        "max_n": score.size.max_n,
    }
    if score.diverged_at_s is not None:
        fields["diverged_at_s"] = score.diverged_at_s
    if name == _WITH_BAND:
        width_n = score.band.width_n
        fields["coverage_95"] = score.band.coverage
        fields["band_width_n"] = width_n if width_n is not None and isfinite(width_n) else None
        fields["leading_expert"] = score.band.leading
    return fields
