"""A diagnosis in a process of its own: stamps, positions and forces on stdin, one line of JSON on stdout."""

import json
import os
import sys
from io import BytesIO

import numpy as np

from forefeel.child_process import die_with_parent
from forefeel.common.causes.catalogue import words
from forefeel.common.error_size import Floats
from forefeel.common.errors import ForefeelError
from forefeel.common.recording.recording import Recording
from forefeel.diagnose.answer import headline
from forefeel.diagnosis.diagnose import diagnose
from forefeel.diagnosis.verdict import Diagnosis, Interval
from forefeel.report.wording import shown

_LOWEST_NICE = 19  # niceness of the lowest priority (nice(2))
_LEFT_OUT = "The model leaves out:"


def main() -> None:
    """Diagnoses what stands on stdin at the lowest priority, whatever else the host does."""
    os.nice(_LOWEST_NICE)
    die_with_parent()
    rows = np.load(BytesIO(sys.stdin.buffer.read()), allow_pickle=False)
    print(json.dumps(diagnosed(rows)), flush=True)


def diagnosed(rows: Floats) -> dict[str, object]:
    """The answer for rows (n, 3) of stamp in s, position in m, force in N: headline, line per cause."""
    try:
        recording = Recording("live", rows[:, 0] - rows[0, 0], rows[:, 1], rows[:, 2], "the last minute")
        found = diagnose(recording).diagnosis
    except ForefeelError as error:
        return {"headline": f"Nothing can be said: {error}.", "causes": [], "final": False}
    return {
        "headline": _LEFT_OUT if found.verdict == "cause_found" else headline(found),
        "causes": [*_causes(found), *_next(found)],
        "final": found.verdict == "cause_found",
    }


def _causes(found: Diagnosis) -> list[str]:
    """Or the rivals, those of a group in a line."""
    return [" or ".join(map(words, group)) for group in found.rivals] + [
        f"{words(cause.name)}: {', '.join(_value(*each) for each in cause.parameters.items())}"
        for cause in found.causes
    ]


def _value(name: str, interval: Interval) -> str:
    known = shown(name, interval)
    return f"{known.label} {known.value} {known.unit}".rstrip()


def _next(found: Diagnosis) -> list[str]:
    return [f"record next: {found.suggested_motion}"] if found.suggested_motion else []


if __name__ == "__main__":
    main()
