"""The generator's forces against closed forms."""

from math import pi

import numpy as np
import pytest

from tests.hidden_effects.generator.draw import FORMS
from tests.hidden_effects.generator.motion import Motion
from tests.hidden_effects.generator.parts import Base, Part, Place, Signal, transmit
from tests.hidden_effects.generator.scan import Array

_T = np.arange(0.0, 4.0, 1e-4)
_NOTHING, _SPRING = Base(0.0, 0.0, 0.0), Base(0.0, 0.0, 20.0)


def _part(name: str, label: str, **values: float) -> Part:
    (form,) = [form for form in FORMS if (form.name, form.label) == (name, label)]
    return Part(form, values)


def _ramp(speed: float = 0.01) -> Motion:
    return Motion(_T, speed * _T, np.full(len(_T), speed), np.zeros(len(_T)))


def _sine(hz: float, size: float = 0.01) -> Motion:
    w = 2.0 * pi * hz
    x = size * np.sin(w * _T)
    return Motion(_T, x, size * w * np.cos(w * _T), -w * w * x)


def _gain(force: Array, hz: float) -> complex:
    """Complex amplitude against sin over the last two seconds."""
    late = _T >= 2.0 - 1e-9
    turn = np.exp(-2j * pi * hz * _T[late])
    return complex(2j * np.mean(force[late] * turn))


def test_base() -> None:
    motion = _sine(1.0)
    force = transmit(motion, Base(0.3, 2.0, 20.0), ())
    np.testing.assert_allclose(force, 0.3 * motion.a + 2.0 * motion.v + 20.0 * motion.x)


@pytest.mark.parametrize("label", ["Dahl", "LuGre"])
def test_presliding_at_constant_speed(label: str) -> None:
    part = _part("presliding_hysteresis", label, force_n=0.1, stiffness_n_m=40.0, bristle_n_s_m=0.0)
    expected = 0.1 * -np.expm1(-40.0 * 0.01 * _T / 0.1)
    np.testing.assert_allclose(transmit(_ramp(), _NOTHING, (part,)), expected, atol=5e-5)


def test_presliding_forgets_nothing_at_rest() -> None:
    x, v = np.minimum(_T, 1.0) * 0.01, np.where(_T < 1.0, 0.01, 0.0)
    still = Motion(_T, x, v, np.zeros(len(_T)))
    part = _part("presliding_hysteresis", "LuGre", force_n=0.1, stiffness_n_m=40.0, bristle_n_s_m=0.3)
    late = transmit(still, _NOTHING, (part,))[_T > 1.01]
    assert np.ptp(late) < 1e-12
    assert late[0] == pytest.approx(0.1 * -np.expm1(-4.0), rel=1e-3)


def test_maxwell_branch_at_constant_speed() -> None:
    part = _part("stress_relaxation", "one branch", stiffness_n_m=30.0, time_constant_s=0.5)
    expected = 30.0 * 0.5 * 0.01 * -np.expm1(-_T / 0.5)
    np.testing.assert_allclose(transmit(_ramp(), _NOTHING, (part,)), expected, atol=1e-4)


@pytest.mark.parametrize("hz", [0.5, 2.0, 6.5])
def test_lag_delay_and_modes_by_their_frequency_response(hz: float) -> None:
    motion, s = _sine(hz), 2j * pi * hz
    spring = 20.0 * 0.01
    lag = _part("sensor_lag", "first order", time_constant_s=0.04)
    assert _gain(transmit(motion, _SPRING, (lag,)), hz) == pytest.approx(spring / (1.0 + 0.04 * s), rel=2e-3)
    delay = _part("time_delay", "delay", delay_s=0.03)
    assert _gain(transmit(motion, _SPRING, (delay,)), hz) == pytest.approx(
        spring * np.exp(-0.03 * s), rel=2e-3
    )
    w = 2.0 * pi * 5.0
    response = w * w / (s * s + 0.3 * w * s + w * w)
    fixture = _part("unmodelled_resonance", "fixture", frequency_hz=5.0, damping_ratio=0.15)
    assert _gain(transmit(motion, _SPRING, (fixture,)), hz) == pytest.approx(spring * response, rel=5e-3)
    hung = _part("unmodelled_resonance", "flexible mass", frequency_hz=5.0, damping_ratio=0.15, mass_kg=0.2)
    pulled = 0.2 * 0.01 * s * s * (w * w + 0.3 * w * s) / (s * s + 0.3 * w * s + w * w)
    assert _gain(transmit(motion, _NOTHING, (hung,)), hz) == pytest.approx(pulled, rel=5e-3)


def test_friction_levels() -> None:
    motion = _sine(0.5)
    fast = np.abs(motion.v) > 1e-3
    way = np.where(motion.v > 0.0, 1.0, -1.0)[fast]
    coulomb = _part("coulomb_friction", "symmetric", force_n=0.1, blur_m_s=2e-5)
    np.testing.assert_allclose(transmit(motion, _NOTHING, (coulomb,))[fast], 0.1 * way)
    uneven = _part("coulomb_friction", "asymmetric", forward_n=0.1, backward_n=0.04, blur_m_s=2e-5)
    np.testing.assert_allclose(transmit(motion, _NOTHING, (uneven,))[fast], np.where(way > 0.0, 0.1, -0.04))
    values = {"coulomb_n": 0.05, "static_n": 0.1, "stribeck_velocity_m_s": 5e-3, "blur_m_s": 2e-5}
    falls = 0.05 + 0.05 * np.exp(-((motion.v[fast] / 5e-3) ** 2))
    stribeck = _part("stribeck_friction", "gaussian", **values)
    np.testing.assert_allclose(transmit(motion, _NOTHING, (stribeck,))[fast], falls * way)
    capstan = _part("position_dependent_friction", "capstan", force_per_length_n_m=4.0, blur_m_s=2e-5)
    expected = 4.0 * np.maximum(motion.x[fast], 0.0) * way
    np.testing.assert_allclose(transmit(motion, _NOTHING, (capstan,))[fast], expected)


def test_walls_and_fluids() -> None:
    motion = _sine(0.7)
    x, v = motion.x, motion.v
    closed = [
        (_part("stiffening", "polynomial", quadratic_n_m2=100.0, cubic_n_m3=1e4), 100.0 * x**2 + 1e4 * x**3),
        (_part("stiffening", "Fung", level_n=0.02, length_m=5e-3), 0.02 * (np.exp(x / 5e-3) - 1.0)),
        (_part("hunt_crossley_damping", "x v", damping_n_s_m2=200.0), 200.0 * np.where(x > 0.0, x * v, 0.0)),
        (_part("quadratic_drag", "v |v|", drag_n_s2_m2=30.0), 30.0 * np.sign(v) * v * v),
        (_part("asymmetric_damping", "two slopes", difference_n_s_m=2.0), 2.0 * v * (v > 0.0)),
        (_part("asymmetric_damping", "two slopes", difference_n_s_m=-2.0), 2.0 * v * (v < 0.0)),
        (_part("stiffness_change", "step", time_s=1.3, ratio=0.4), np.zeros_like(x)),
    ]
    for part, expected in closed:
        np.testing.assert_allclose(transmit(motion, _NOTHING, (part,)), expected, atol=1e-12)
    changed = transmit(motion, _SPRING, (_part("stiffness_change", "step", time_s=1.3, ratio=0.4),))
    np.testing.assert_allclose(changed, np.where(_T < 1.3, 20.0, 8.0) * x, atol=1e-12)


@pytest.mark.parametrize("label", ["nothing before", "mass carried"])
def test_no_wall_before_contact(label: str) -> None:
    motion, base = _sine(0.5), Base(0.3, 2.0, 20.0)
    part = _part("contact_loss", label, contact_position_m=4e-3, low_m=0.0)
    force, apart = transmit(motion, base, (part,)), motion.x <= 4e-3
    mass = 0.3 * motion.a
    carried = mass if label == "mass carried" else np.zeros_like(mass)
    np.testing.assert_allclose(force[apart], carried[apart])
    inside = mass + 2.0 * motion.v + 20.0 * (motion.x - 4e-3)
    np.testing.assert_allclose(force[~apart], inside[~apart])


def test_play_carries_only_at_its_ends() -> None:
    motion = _sine(0.5)
    part = _part("backlash", "play", width_m=4e-3)
    spring, damper = (transmit(motion, base, (part,)) for base in (_SPRING, Base(0.0, 2.0, 0.0)))
    assert np.ptp(spring[_T > 2.0]) == pytest.approx(20.0 * (0.02 - 4e-3), rel=1e-3)
    resting = np.abs(np.diff(spring)) < 1e-12
    assert np.all(damper[1:][resting & (_T[1:] > 0.1)] == 0.0)
    assert 0.1 < np.mean(resting) < 0.5


def _read(part: Part, force: Array) -> Array:
    zeros = np.zeros_like(force)
    signal = Signal(_NOTHING, _T[: len(force)] * 10.0, zeros, zeros, zeros, force)
    assert part.form.place is Place.READING
    part.form.act(signal, part.values)
    return signal.force


def test_readings() -> None:
    force = 0.3 * np.sin(2.0 * pi * 3.0 * _T)
    clipped = _read(_part("sensor_saturation", "symmetric", limit_n=0.2), force)
    assert (np.max(clipped), np.min(clipped)) == (0.2, -0.2)
    assert np.array_equal(clipped[np.abs(force) < 0.2], force[np.abs(force) < 0.2])
    levels = _read(_part("sensor_quantisation", "mid-tread", step_n=0.07), force) / 0.07
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-9)
    assert np.max(np.abs(levels * 0.07 - force)) <= 0.035 + 1e-12
    spikes = (
        _read(_part("sensor_spikes", "single samples", rate_hz=5.0, amplitude_n=2.0, train=1.0), force)
        - force
    )
    size = np.abs(spikes[spikes != 0.0])
    assert 130 <= len(size) <= 270
    assert np.mean(size) == pytest.approx(2.0, rel=0.05)


def test_periodic_and_slow_forces() -> None:
    values = {"phase_1": 0.3, "phase_2": 1.0, "phase_3": 0.0, "ratio_2": 0.5, "ratio_3": 0.0}
    motion = _ramp(0.0)
    for name, label, hz in (("pulsation", "heart or breath", 1.5), ("mains_hum", "50 or 60 Hz", 50.0)):
        force = transmit(motion, _NOTHING, (_part(name, label, frequency_hz=hz, amplitude_n=0.1, **values),))
        assert abs(_gain(force, hz)) == pytest.approx(0.1, rel=1e-2)
        assert abs(_gain(force, 2.0 * hz)) == pytest.approx(0.05, rel=1e-2)
    ramp = _part("sensor_drift", "ramp", rate_n_s=0.02, settling_s=1.0)
    np.testing.assert_allclose(transmit(motion, _NOTHING, (ramp,)), 0.02 * _T)
    creep = transmit(motion, _NOTHING, (_part("sensor_drift", "creep", rate_n_s=0.02, settling_s=0.5),))
    assert creep[1] / 1e-4 == pytest.approx(0.02, rel=1e-3)
    assert creep[-1] == pytest.approx(0.01, rel=1e-3)
    bias = transmit(motion, _NOTHING, (_part("bias", "constant", force_n=-0.05),))
    assert np.all(bias == -0.05)
