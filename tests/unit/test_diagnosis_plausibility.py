"""Which recordings are asked about their units, and what would make them usual."""

from dataclasses import replace

import pytest

from forefeel.diagnosis.plausibility import question
from tests.unit.diagnosis_samples import made

ASKED = {
    "epoch milliseconds": ((1e3, 1.0, 1.0), 1.7e12, ("time", 1e-3)),
    "epoch microseconds": ((1e6, 1.0, 1.0), 1.7e15, ("time", 1e-6)),
    "epoch nanoseconds": ((1e9, 1.0, 1.0), 1.7e18, ("time", 1e-9)),
    "seconds taken for microseconds": ((1e-6, 1.0, 1.0), 0.0, ("time", 1e6)),
    "millimetres": ((1.0, 1e3, 1.0), 0.0, ("position", 1e-3)),
    "millimetres, soft": ((1.0, 0.2e3, 0.05), 0.0, ("position", 1e-3)),
    "micrometres": ((1.0, 1e6, 1.0), 0.0, ("position", 1e-6)),
    "millinewtons": ((1.0, 1.0, 30e3), 0.0, ("force", 1e-3)),
    "too stiff": ((1.0, 1e-6, 5e3), 0.0, ("force", 1e-3)),
    "no force to speak of": ((1.0, 1.0, 1e-8), 0.0, ("force", 1e3)),
    "as it is": ((1.0, 1.0, 1.0), 1.7e9, None),
    "a joint in rad and N m": ((1.0, 200.0, 100.0), 0.0, None),
    "piezo stage": ((1.0, 1e-3, 10.0), 0.0, None),
    "catheter of millinewtons": ((1.0, 5.0, 3e-3), 0.0, None),
}


@pytest.mark.parametrize(("factors", "origin_s", "expected"), ASKED.values(), ids=ASKED)
def test_units_are_asked_for(
    factors: tuple[float, float, float], origin_s: float, expected: tuple[str, float] | None
) -> None:
    recording = made(6.0, friction_n=0.08)
    assert recording.force_n is not None
    columns = recording.time_s, recording.position_m, recording.force_n
    time_s, position_m, force_n = (f * column for f, column in zip(factors, columns, strict=True))
    changed = replace(recording, time_s=time_s + origin_s, position_m=position_m, force_n=force_n)
    asked = question(changed)
    assert (asked and (asked.quantity, asked.factor)) == expected
