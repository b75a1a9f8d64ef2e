"""The guidewires' recordings are what their truth says, and their wire obeys the formulas of its physics."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from forefeel.common.recording.recording import Recording
from forefeel.diagnosis.diagnose import diagnose
from tests.hidden_effects.guidewire import KINDS, draw
from tests.hidden_effects.guidewire.patient import Rhythm
from tests.hidden_effects.guidewire.wire import Rub, Run, Wire, along, euler_n, force, swinging
from tests.hidden_effects.laboratory.motion import Motion, moved
from tests.hidden_effects.laboratory.score import NAMED, judge, statements
from tests.hidden_effects.laboratory.truth import Array
from tests.hidden_effects.product import diagnosed
from tests.hidden_effects.test_laboratory import _answer, _truth, check_two_motions


class Seen(NamedTuple):
    """All that the diagnosis sees of a recording."""

    time_s: Array
    position_m: Array
    force_n: Array


_BARE = Wire(mass_kg=0.0, damping_n_s_m=0.0, stiffness_n_m=50.0)
_DRAGS = replace(_BARE, mass_kg=0.05, damping_n_s_m=2.0)
_T = np.arange(0.0, 14.0, 1e-2)


def _stroke(depth_m: float = 0.04, lasts_s: float = 4.0) -> Motion:
    """In and out, twice, each way at one speed."""
    t = np.arange(0.0, 4.0 * lasts_s, 2e-3)
    return moved(t, depth_m * np.abs(((t / lasts_s + 1.0) % 2.0) - 1.0))


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_gives_the_same_again_and_another_motion_of_it(kind: str) -> None:
    one, again = draw(kind, 4), draw(kind, 4)
    check_two_motions(one)
    assert one.truth == again.truth
    assert np.array_equal(one.force, again.force) and np.array_equal(one.position, again.position)
    assert 8e-3 < np.ptp(one.position) < 65e-3


@pytest.mark.parametrize("kind", ["known", "new", "mixture", "outside"])
def test_what_is_hidden_is_neither_lost_nor_all_there_is(kind: str) -> None:
    for seed in range(20, 23):
        truth = draw(kind, seed).truth
        least = max(0.06, 3.0 * truth.noise_n / truth.force_n)
        hidden = [share for name, share in truth.names if name != "time_delay"] or [truth.hidden]
        assert truth.outside or len(hidden) in ((2, 3) if kind == "mixture" else (1,))
        assert least < min(hidden) and max(hidden) < 0.5


def test_nothing_is_mass_damper_and_spring() -> None:
    recorded = draw("nothing", 1)
    truth = recorded.truth
    left = recorded.force - recorded.force_clean
    assert truth.hidden < 0.03 and not truth.outside
    assert np.std(left - np.mean(left)) < 1.5 * np.hypot(truth.noise_n, truth.left_n)


def test_friction_along_the_path_grows_with_the_inserted_length() -> None:
    m = _stroke()
    total = force(replace(_BARE, stiffness_n_m=0.0, entry_m=5e-3, rubs=(Rub(0.02, 8.0, 1e-3),)), Run(m))
    deep = m.x > 0.01
    way_in, way_out = deep & (m.v > 0.0), deep & (m.v < 0.0) & (m.x < 0.037)
    linear = 0.02 + 8.0 * (m.x - 5e-3)
    assert np.allclose(total[way_in], linear[way_in], rtol=0.02)
    assert np.allclose(total[way_out], -linear[way_out], rtol=0.02)
    bend = force(replace(_BARE, stiffness_n_m=0.0, rubs=(Rub(0.0, 8.0, 1e-3, 0.01, 0.015),)), Run(m))
    assert np.allclose(bend[way_in], 8.0 * np.minimum(m.x - 0.01, 0.015)[way_in], rtol=0.02)


def test_a_bend_multiplies_the_tip_as_euler_and_eytelwein_say() -> None:
    m = _stroke()
    tip = force(_BARE, Run(m))
    bent = force(replace(_BARE, wrap=(0.3, 10.0)), Run(m))
    inside = (m.x > 1e-3) & (m.x < 0.039)
    expected = tip * np.exp((0.3 + 10.0 * m.x) * np.sign(m.v))
    assert np.allclose(bent[inside], expected[inside], rtol=0.01)


def test_a_wire_buckles_at_eulers_load_of_its_free_length() -> None:
    m = _stroke()
    wire = replace(_BARE, euler_n_m2=np.pi**2 * 1.5e-4 / 0.7**2, free_m=0.09)
    total = force(wire, Run(m))
    limit = np.array([euler_n(wire, x) for x in m.x])
    assert limit[0] == pytest.approx(np.pi**2 * 1.5e-4 / (0.7 * 0.09) ** 2)
    buckled = 50.0 * m.x > limit
    assert np.mean(buckled) > 0.1 and np.all(np.diff(limit[m.v > 0.0][:1000]) > 0.0)
    assert np.allclose(total[buckled], (limit + 0.03 * (50.0 * m.x - limit))[buckled], atol=1e-9)
    assert np.allclose(total[~buckled], 50.0 * m.x[~buckled], atol=1e-9)


def test_a_gripper_slips_where_the_force_passes_what_it_holds() -> None:
    m = _stroke()
    total, slipped_m = along(replace(_BARE, holding_n=1.21, slip_m=2e-3), m)
    starts = np.flatnonzero((np.diff(slipped_m) > 0.0) & (np.diff(slipped_m, prepend=0.0)[:-1] == 0.0))
    assert len(starts) == 8  # from 24.2 to 38.2 mm
    assert np.all(np.abs(total[starts + 1] - 1.21) < 0.01) and np.max(total) < 1.23
    assert slipped_m[-1] == pytest.approx(16e-3, abs=1e-6)


def test_a_wall_yields_and_a_tip_lets_go() -> None:
    m = _stroke()
    yielded = force(replace(_BARE, one_sided=True, yield_n=1.0), Run(m))
    assert np.max(yielded) == pytest.approx(1.0) and np.min(yielded) == 0.0
    assert np.allclose(yielded[m.t > 4.0], np.maximum(50.0 * (m.x - 0.02), 0.0)[m.t > 4.0], atol=1e-3)
    folded = force(replace(_BARE, prolapse_n=1.0, kept=0.2), Run(m))
    assert np.max(folded) < 1.1
    out = (m.v < 0.0) & (m.x < 0.038)
    loaded = out & (50.0 * m.x > 0.26)
    assert np.allclose(folded[loaded], 10.0 * m.x[loaded], atol=0.01)
    assert np.allclose(folded[out & (m.x < 2e-3)], 50.0 * m.x[out & (m.x < 2e-3)], atol=0.01)


_SETTLES = {"settling": 0.4 * np.exp(-_T / 2.0) + 0.05 * np.sin(0.7 * _T)}


@pytest.mark.parametrize(
    ("wire", "units", "name", "value", "true"),
    [
        (replace(_DRAGS, one_sided=True, yield_n=1.0), {}, "yielding_wall", "yield_n", 1.0),
        (replace(_DRAGS, one_sided=True, rest_m=0.01, toe_m=1e-3), {}, "contact_loss", "", 0.0),
        (replace(_DRAGS, prolapse_n=1.2, kept=0.3), {}, "prolapse", "limit_n", 1.2),
        (replace(_DRAGS, beside={"settling": 1.0}), _SETTLES, "sensor_drift", "settling_s", 2.0),
    ],
)
def test_diagnosis_finds_what_a_wire_remembers(
    wire: Wire, units: dict[str, Array], name: str, value: str, true: float
) -> None:
    """Strokes of several depths by the integrator, with 4 mN of noise; a wall that only begins is none."""
    depth_m = 0.03 * np.sin(1.3 * _T) ** 2 * (0.7 + 0.3 * np.cos(0.37 * _T + 3.0))
    m = moved(_T, depth_m)
    noise = 4e-3 * np.random.default_rng(1).standard_normal(len(_T))
    found = diagnose(Recording("wire", _T, m.x, force(wire, Run(m, units)) + noise, "wire")).diagnosis
    assert found.causes[0].name == name
    if value:
        assert found.causes[0].parameters[value].value == pytest.approx(true, rel=0.1)


def test_a_mass_that_hangs_on_the_stage_amplifies_at_its_frequency() -> None:
    t = np.arange(0.0, 40.0, 2e-3)
    pull = swinging(moved(t, np.sin(2.0 * np.pi * 4.0 * t)), 4.0, 0.05)[-2000:]
    assert np.max(pull) == pytest.approx((8.0 * np.pi) ** 2 / (2.0 * 0.05), rel=0.02)


def test_the_rate_of_a_living_heart_varies_by_its_share() -> None:
    t = np.arange(0.0, 60.0, 5e-3)
    heart = Rhythm(np.random.default_rng(1), 1.2, 0.06)
    line = np.abs(np.fft.rfft(heart.along(np.random.default_rng(2), t)))
    hz = np.fft.rfftfreq(len(t), 5e-3)
    near = (hz > 0.9) & (hz < 1.5)
    centre = np.sum(hz[near] * line[near] ** 2) / np.sum(line[near] ** 2)
    width = np.sqrt(np.sum((hz[near] - centre) ** 2 * line[near] ** 2) / np.sum(line[near] ** 2))
    assert centre == pytest.approx(1.2, rel=0.03)
    assert width == pytest.approx(0.06 * 1.2, rel=0.5)


_TWO = {"names": [["coulomb_friction", 0.4], ["pulsation", 0.2]]}


@pytest.mark.parametrize(
    ("truth", "answer", "expected"),
    [
        (_TWO, _answer("partly_explained", "coulomb_friction"), {"right first", "rest told"}),
        (_TWO, _answer("cause_found", "coulomb_friction"), {"right first"}),
        (_TWO, _answer("cause_found", "stribeck_friction", "pulsation"), {"right first", "rest told"}),
        (_TWO, _answer("cause_found", "pulsation", "bias"), {"lesser"}),
        (_TWO, _answer("partly_explained", "stiffening"), {"wrong first", "superfluous"}),
        (_TWO, _answer("cause_found", "coulomb_friction", "play"), {"right first", "superfluous"}),
        (_TWO, _answer("cause_found", "bias"), {"false"}),
        (_TWO, _answer("not_driven_by_this_axis"), {"false"}),
        (_TWO, _answer("unexplained"), {"abstains", "timid"}),
        ({"names": [], "hidden": 0.01, "kind": "nothing"}, _answer("nothing_missing"), set()),
    ],
)
def test_what_is_said_first_is_told_apart(
    truth: dict[str, Any], answer: dict[str, Any], expected: set[str]
) -> None:
    assert statements(judge(_truth(**truth), answer)) == expected


@pytest.mark.parametrize(("seed", "name"), [(1029, "gripper_slip"), (1052, "buckling")])
def test_a_wire_that_gives_way_at_the_gripper_is_named(seed: int, name: str) -> None:
    """A creep that an untared cell shows, and a bow."""
    recorded = draw("new", seed)
    answer = diagnosed(Seen(recorded.time_s, recorded.position, recorded.force))
    assert answer.verdict in NAMED and answer.names[0] == name
