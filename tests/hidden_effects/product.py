"""The diagnosis under test: it gets the recording and nothing else."""

import json
import time

from forefeel.common.errors import InputError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import diagnose
from tests.hidden_effects.answers import Answer, Measured, from_document


def diagnosed(measured: Measured) -> Answer:
    """Its answer; the verdict `refused` stands for an input error."""
    recording = Recording("hidden", measured.time_s, measured.position_m, measured.force_n, "hidden")
    start_s = time.perf_counter()
    try:
        result = diagnose(recording)
    except InputError:
        return Answer("refused", seconds=time.perf_counter() - start_s)
    document = json.loads(json.dumps(result.diagnosis.to_mapping()))
    return from_document(document, time.perf_counter() - start_s)
