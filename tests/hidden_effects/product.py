"""The diagnosis under test: it gets the recording and nothing else."""

import json
import time
from math import nan

from forefeel.common.errors import InputError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import diagnose
from tests.hidden_effects.answers import Answer, Measured

_SCHEMA = "forefeel.diagnosis/3"


def recording_of(measured: Measured) -> Recording:
    return Recording("hidden", measured.time_s, measured.position_m, measured.force_n, "hidden")


def diagnosed(measured: Measured) -> Answer:
    """Its answer as diagnosis.json has it; the verdict `refused` stands for an input error."""
    start_s = time.perf_counter()
    try:
        diagnosis = diagnose(recording_of(measured)).diagnosis
    except InputError:
        return Answer("refused", seconds=time.perf_counter() - start_s)
    document = json.loads(json.dumps(diagnosis.to_mapping()))
    assert document["schema"] == _SCHEMA, document["schema"]
    return Answer(
        verdict=document["verdict"],
        names=tuple(cause["name"] for cause in document["causes"]),
        parameters={
            cause["name"]: {
                name: (_number(p["value"]), _number(p["low"]), _number(p["high"]))
                for name, p in cause["parameters"].items()
            }
            for cause in document["causes"]
        },
        rivals=tuple(tuple(names) for names in document["rivals"]),
        gain=_number(document["held_out"]["gain"]),
        gain_low=_number(document["held_out"]["gain_low"]),
        seconds=time.perf_counter() - start_s,
    )


def _number(value: float | None) -> float:
    return nan if value is None else value
