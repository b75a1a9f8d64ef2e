"""The diagnosis under test: it gets the recording and nothing else."""

import json
import time

from forefeel.common.errors import InputError
from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import diagnose
from tests.hidden_effects.answers import Answer, from_document
from tests.hidden_effects.generator import Hidden


def diagnosed(hidden: Hidden) -> Answer:
    """Its answer; the verdict `refused` stands for an input error."""
    recording = Recording("hidden", hidden.time_s, hidden.position_m, hidden.force_n, "hidden")
    start_s = time.perf_counter()
    try:
        result = diagnose(recording)
    except InputError:
        return Answer("refused", seconds=time.perf_counter() - start_s)
    document = json.loads(json.dumps(result.diagnosis.to_mapping()))
    return from_document(document, time.perf_counter() - start_s)
