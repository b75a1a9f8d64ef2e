"""A long recording in pieces: where they lie, which moves most, and the sensor's faults of all of them."""

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise

import numpy as np

from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose.faults import Fault, clean
from forefeel.diagnosis.diagnose.signals import Mask


def cut(recording: Recording, part: slice | Mask) -> Recording:
    """A part of a recording, with its stamps."""
    assert recording.force_n is not None
    return Recording(
        recording.name, recording.time_s[part], recording.position_m[part], recording.force_n[part],
        recording.source,
    )  # fmt: skip


def chunks_of(recording: Recording, length_s: float) -> list[slice]:
    """The recording in pieces of about that length, none across a gap, none shorter than 3 s."""
    found = []
    for piece in recording.segments(max(0.1, 3.5 / recording.rate_hz)):
        time_s = recording.time_s[piece]
        count = max(1, round(float(time_s[-1] - time_s[0]) / length_s))
        edges = np.linspace(piece.start, piece.stop, count + 1).astype(np.int64)
        parts = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        found += [p for p in parts if recording.time_s[p.stop - 1] - recording.time_s[p.start] >= 3.0]
    return found


def cleaned_everywhere(recording: Recording, chunks: list[slice]) -> tuple[Recording, Mask, list[Fault]]:
    """Without lines and spikes of the force, which samples were clipped, the faults of all chunks merged."""
    assert recording.force_n is not None
    force_n, unusable = recording.force_n, np.zeros(len(recording), dtype=np.bool_)
    seen: dict[str, list[tuple[Fault, float]]] = defaultdict(list)
    for chunk in chunks:
        part = cut(recording, chunk)
        cleaned = clean(part)
        unusable[chunk] = cleaned.clipped
        if not np.array_equal(cleaned.force_n, recording.force_n[chunk]):
            if force_n is recording.force_n:
                force_n = recording.force_n.copy()  # not before: an hour at 1 kHz is 29 MB
            force_n[chunk] = cleaned.force_n
        for fault in cleaned.faults:
            seen[fault.name].append((fault, part.duration_s))
    total = sum(float(recording.time_s[c.stop - 1] - recording.time_s[c.start]) for c in chunks)
    merged = [_merged(found, total) for found in seen.values()]
    force_n.flags.writeable = False  # handed over, not copied
    cleaned_recording = replace(recording, force_n=force_n)
    return cleaned_recording, unusable, [fault for fault in merged if fault is not None]


def liveliest(recording: Recording, length_s: float) -> slice:
    """The stretch of that length with the longest way."""
    count = min(int(length_s * recording.rate_hz), len(recording))
    step = max(1, int(0.05 * recording.rate_hz))
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(recording.position_m[::step])))])
    reach = max(1, min(count // step, len(way) - 1))
    start = int(np.argmax(way[reach:] - way[:-reach])) * step
    return slice(start, min(start + count, len(recording)))


def _merged(found: list[tuple[Fault, float]], total_s: float) -> Fault | None:
    """One fault of all chunks; a comb or a line that most of the chunks lack is none."""
    longest, covered = max(found, key=lambda pair: pair[1])[0], sum(duration for _, duration in found)
    share = covered / total_s
    if longest.name in ("sensor_quantisation", "mains_hum") and share < 0.5:
        return None
    parameters = {
        key: _together([fault.parameters[key] for fault, _ in found], share if key == "rate_hz" else 1.0)
        for key in longest.parameters
    }
    rms_n = float(np.sqrt(np.mean([fault.rms_n**2 for fault, _ in found]) * share))
    return Fault(longest.name, parameters, longest.evidence, rms_n)


def _together(values: list[tuple[float, float, float]], share: float) -> tuple[float, float, float]:
    """Mean of the values and their intervals, narrower by the root of their number."""
    value, low, high = np.mean(values, axis=0)
    narrow = 1.0 / np.sqrt(len(values))
    return tuple(float(share * (value + narrow * off)) for off in (0.0, low - value, high - value))  # type: ignore[return-value]
