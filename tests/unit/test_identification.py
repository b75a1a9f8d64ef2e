from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import cos, inf, nan, pi, sin, sqrt
from random import Random
from statistics import mean, stdev

import pytest

from forefeel.common.causes.model import ContactModel
from forefeel.common.estimation.identification import (
    ContactEstimate,
    ContactIdentifier,
    IdentificationSettings,
    linear_bounds,
    nominal_scales,
)
from forefeel.common.estimation.prediction import ContactPredictor

MS = 1_000_000
START_NS = 7_000_000_000_000_000
M, B, K, BIAS = 0.05, 0.6, 80.0, 0.12
TRUTH = {
    "mass_damper_spring.mass_kg": M,
    "mass_damper_spring.damping_n_s_m": B,
    "mass_damper_spring.stiffness_n_m": K,
    "bias.force_n": BIAS,
}
TONES = ((0.004, 0.37, 0.3), (0.002, 0.91, 1.1), (0.001, 2.3, 2.0), (0.0003, 4.1, 0.7))
PURE = ((0.004, 1.0, 0.0),)
Tones = Sequence[tuple[float, float, float]]


def contact(*more: object) -> ContactModel:
    effects = [{"effect": "mass_damper_spring"}, {"effect": "bias"}, *more]
    return ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "contact", "effects": effects})


def motion(t: float, tones: Tones = TONES) -> tuple[float, float, float]:
    x = v = a = 0.0
    for amplitude_m, frequency_hz, phase in tones:
        w = 2.0 * pi * frequency_hz
        x += amplitude_m * sin(w * t + phase)
        v += amplitude_m * w * cos(w * t + phase)
        a -= amplitude_m * w * w * sin(w * t + phase)
    return x, v, a


def linear_force_n(t: float, tones: Tones = TONES) -> float:
    x, v, a = motion(t, tones)
    return M * a + B * v + K * x + BIAS


Sample = tuple[int, float, float]


def recorded(
    rng: Random, duration_s: float, tones: Tones = TONES, noise_n: float = 0.002
) -> Iterator[Sample]:
    """Samples at about 1 kHz: jittered stamps, 1 um encoder, noise."""
    for i in range(round(duration_s * 1000)):
        stamp_ns = i * MS + rng.randrange(MS // 5)
        t = stamp_ns * 1e-9
        force_n = linear_force_n(t, tones) + rng.gauss(0.0, noise_n)
        yield START_NS + stamp_ns, round(motion(t, tones)[0] * 1e6) * 1e-6, force_n


def identified(samples: Iterator[Sample], **settings: float) -> ContactIdentifier:
    identifier = ContactIdentifier(contact(), replace(IdentificationSettings(), **settings))  # type: ignore[arg-type]
    for sample in samples:
        identifier.observe(*sample)
    return identifier


def by_name(estimate: ContactEstimate) -> dict[str, float]:
    return dict(zip(estimate.names, estimate.values, strict=True))


def test_parameters_of_a_linear_contact_from_noisy_irregular_samples() -> None:
    identifier = identified(recorded(Random(1), 12.0))
    estimate = identifier.estimate()
    assert estimate.valid
    assert by_name(estimate) == pytest.approx(TRUTH, rel=0.02)
    assert identifier.identifiable() == ()
    assert estimate.samples == 12_000
    assert estimate.noise_variance_n2 == pytest.approx(0.002**2 * 2.0 * 1.047 * 10.0 * 0.001, rel=0.35)
    assert (estimate.resets, identifier.ignored, identifier.refused) == (0, 0, 0)


def test_standard_deviations_are_those_of_repeated_runs() -> None:
    runs = [identified(recorded(Random(seed), 3.0, noise_n=0.02)).estimate() for seed in range(12)]
    for i, name in enumerate(runs[0].names):
        spread = stdev(run.values[i] for run in runs)
        reported = mean(run.standard_deviations[i] for run in runs)
        assert 0.5 * spread < reported < 3.0 * spread, name


def test_a_pure_sine_is_reported_in_words_and_what_it_determines_is_right() -> None:
    identifier = identified(recorded(Random(2), 8.0, PURE))
    (statement,) = identifier.identifiable()
    assert statement == (
        "mass_damper_spring.mass_kg and mass_damper_spring.stiffness_n_m only as "
        "mass_damper_spring.stiffness_n_m - 39.5 mass_damper_spring.mass_kg"
    )
    assert identifier.identifiability().identified == (True, False, True, False)
    estimate = identifier.estimate()
    parameters = by_name(estimate)
    assert estimate.valid
    m, k = parameters["mass_damper_spring.mass_kg"], parameters["mass_damper_spring.stiffness_n_m"]
    assert m >= 0.0
    assert k - (2.0 * pi) ** 2 * m == pytest.approx(K - (2.0 * pi) ** 2 * M, rel=1e-3)


def test_standing_still_gives_no_valid_estimate() -> None:
    identifier = identified(recorded(Random(3), 6.0, ((0.004, 0.0, 0.5),)))
    assert not identifier.estimate().valid
    assert len(identifier.identifiable()) == 2


def test_a_gap_restarts_the_filters_and_does_not_disturb_the_parameters() -> None:
    samples = list(recorded(Random(5), 8.0))
    gaps = [s for s in samples if not 0.5 < (s[0] - START_NS) * 1e-9 % 1.0 < 0.75]
    identifier = identified(iter(gaps))
    assert identifier.estimate().valid
    assert by_name(identifier.estimate()) == pytest.approx(TRUTH, rel=0.03)


def test_after_a_gap_some_time_passes_before_updates() -> None:
    samples = list(recorded(Random(6), 4.0))
    identifier = identified(iter(samples[:2000]))
    before = identifier.estimate()
    for sample in samples[2500:2600]:
        identifier.observe(*sample)
    settling = identifier.estimate()
    assert (settling.updates, settling.values) == (before.updates, before.values)
    for sample in samples[2600:3000]:
        identifier.observe(*sample)
    assert identifier.estimate().updates > before.updates


def test_stamps_that_do_not_increase_are_ignored_and_counted() -> None:
    samples = list(recorded(Random(7), 2.0))
    clean, disturbed = identified(iter(samples)), ContactIdentifier(contact(), IdentificationSettings())
    for sample in samples:
        disturbed.observe(*sample)
        disturbed.observe(sample[0], 9.0, 9.0)
        disturbed.observe(sample[0] - 5 * MS, 9.0, 9.0)
    assert disturbed.estimate() == clean.estimate()
    assert disturbed.ignored == 4000


def test_numbers_that_are_not_finite_are_refused_and_counted() -> None:
    samples = list(recorded(Random(8), 2.0))
    clean, disturbed = identified(iter(samples)), ContactIdentifier(contact(), IdentificationSettings())
    for stamp_ns, position_m, force_n in samples:
        disturbed.observe(stamp_ns - 1, nan, force_n)
        disturbed.observe(stamp_ns - 1, position_m, inf)
        disturbed.observe(stamp_ns, position_m, force_n)
    assert disturbed.estimate() == clean.estimate()
    assert disturbed.refused == 4000


def test_values_stay_within_the_bounds_of_the_effects() -> None:
    rng, identifier = Random(10), ContactIdentifier(contact(), IdentificationSettings())
    for stamp_ns, position_m, _ in recorded(rng, 3.0):
        identifier.observe(stamp_ns, position_m, -5.0 * position_m + rng.gauss(0.0, 0.001))
    parameters = by_name(identifier.estimate())
    assert parameters["mass_damper_spring.stiffness_n_m"] == 0.0
    assert (
        min(parameters["mass_damper_spring.mass_kg"], parameters["mass_damper_spring.damping_n_s_m"]) >= 0.0
    )


def test_bounds_and_scales_follow_the_names_of_the_runtime() -> None:
    branch = {"effect": "stress_relaxation"}
    model = contact(branch, branch, {"effect": "contact_loss", "parameters": {"contact_position_m": 0.5}})
    names = model.runtime().linear_names
    bounds = dict(zip(names, linear_bounds(model, names), strict=True))
    assert bounds["bias.force_n"] == (-1e4, 1e4)
    assert (
        bounds["stress_relaxation-2.stiffness_n_m"] == bounds["stress_relaxation.stiffness_n_m"] == (0.0, 1e9)
    )
    scales = dict(zip(names, nominal_scales(model, 0.005), strict=True))
    assert scales["bias.force_n"] == 1.0
    w1, w2 = pi, 2.6 * pi
    assert scales["mass_damper_spring.stiffness_n_m"] == pytest.approx(0.005 * sqrt(1.25), rel=0.01)
    assert scales["mass_damper_spring.damping_n_s_m"] == pytest.approx(
        0.0025 * sqrt((w1**2 + w2**2) / 2.0), rel=0.01
    )
    assert scales["mass_damper_spring.mass_kg"] == pytest.approx(
        0.0025 * sqrt((w1**4 + w2**4) / 2.0), rel=0.01
    )


def test_a_model_without_linear_parameters_is_refused() -> None:
    model = ContactModel.from_mapping({"schema": "forefeel.model/1", "name": "empty", "effects": []})
    with pytest.raises(ValueError, match="model 'empty': no linear parameter"):
        ContactIdentifier(model, IdentificationSettings())


DELAY = 300


def predicted_and_held(loss: float) -> tuple[float, float, ContactEstimate]:
    """rms errors after 3 s of the prediction and of the held force, 300 ms late, and the last estimate."""
    rng = Random(11)
    identifier = ContactIdentifier(contact(), IdentificationSettings())
    predictor = ContactPredictor(contact(), cutoff_hz=40.0)
    estimate: ContactEstimate | None = None
    zoh_n, errors, held_errors = 0.0, [], []
    samples = list(recorded(rng, 9.0))
    for i in range(DELAY, len(samples)):
        if rng.random() >= loss:
            identifier.observe(*samples[i - DELAY])
            zoh_n = samples[i - DELAY][2]
        if i % 50 == 0:
            estimate = identifier.estimate()
        x, v, _ = motion(i * 1e-3)
        force_n = predictor.predict(i * MS, round(x * 1e6) * 1e-6, v, estimate)
        if i > 3000 and force_n is not None:
            errors.append(force_n - linear_force_n(i * 1e-3))
            held_errors.append(zoh_n - linear_force_n(i * 1e-3))
    assert estimate is not None
    assert len(errors) == len(samples) - 3001
    return rms(errors), rms(held_errors), estimate


def rms(values: Sequence[float]) -> float:
    return sqrt(mean(value * value for value in values))


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.5])
def test_the_prediction_is_far_better_than_holding_the_late_force(loss: float) -> None:
    predicted_n, zoh_n, estimate = predicted_and_held(loss)
    assert predicted_n < zoh_n / 60.0
    assert predicted_n < 0.004
    assert by_name(estimate) == pytest.approx(TRUTH, rel=0.03)


def valid_estimate(model: ContactModel) -> ContactEstimate:
    names, values = model.runtime().linear_names, model.runtime().linear_values
    return ContactEstimate(
        names=names,
        values=values,
        standard_deviations=(0.0,) * len(names),
        valid=True,
        samples=1,
        updates=1,
        resets=0,
        innovation_rms_n=0.0,
        noise_variance_n2=0.0,
        origin_ns=0,
    )


def test_the_regressors_follow_the_motion_before_there_is_an_estimate() -> None:
    model = contact({"effect": "stress_relaxation", "parameters": {"stiffness_n_m": 50.0}})
    late, early, estimate = (
        ContactPredictor(model, 40.0),
        ContactPredictor(model, 40.0),
        valid_estimate(model),
    )
    for i in range(3000):
        x, v, _ = motion(i * 1e-3)
        unknown = late.predict(i * MS, x, v, None)
        known = early.predict(i * MS, x, v, estimate)
        assert unknown is None
    assert late.predict(3000 * MS, 0.004, 0.0, estimate) == early.predict(3000 * MS, 0.004, 0.0, estimate)
    assert known is not None


def test_the_prediction_at_constant_speed_is_exact() -> None:
    model = contact({"effect": "coulomb_friction", "parameters": {"force_n": 0.03}})
    predictor, estimate = ContactPredictor(model, 40.0), valid_estimate(model)
    for i in range(500):
        force_n = predictor.predict(i * MS, 0.002 * i * 1e-3, 0.002, estimate)
    assert force_n == pytest.approx(1.0 * 0.002 * 0.499 + 0.1 * 0.002 + 0.03, rel=1e-9)


def test_no_prediction_without_a_valid_estimate_or_motion() -> None:
    model = contact()
    predictor, estimate = ContactPredictor(model, 40.0), valid_estimate(model)
    assert predictor.predict(0, 0.001, 0.0, estimate) is None
    assert predictor.predict(MS, 0.001, 0.0, None) is None
    assert predictor.predict(2 * MS, 0.001, 0.0, replace(estimate, valid=False)) is None
    assert predictor.predict(3 * MS, nan, 0.0, estimate) is None
    assert predictor.predict(3 * MS, 0.001, inf, estimate) is None
    force_n = predictor.predict(4 * MS, 0.001, 0.0, estimate)
    assert force_n == pytest.approx(0.001)
    assert predictor.predict(4 * MS, 0.005, 0.0, estimate) == force_n
    assert predictor.predict(500 * MS, 0.001, 0.0, estimate) is None
    assert predictor.predict(501 * MS, 0.001, 0.0, estimate) == pytest.approx(0.001)
    predictor.reset()
    assert predictor.predict(502 * MS, 0.001, 0.0, estimate) is None


def test_an_estimate_of_another_model_is_refused() -> None:
    predictor = ContactPredictor(contact(), 40.0)
    predictor.predict(0, 0.0, 0.0, None)
    with pytest.raises(ValueError, match="expected"):
        predictor.predict(MS, 0.0, 0.0, valid_estimate(contact({"effect": "stress_relaxation"})))


def test_time_dependent_effects_share_the_origin_of_the_estimate() -> None:
    model = contact({"effect": "sensor_drift"})
    identifier = ContactIdentifier(model, IdentificationSettings(memory_s=20.0))
    for stamp_ns, position_m, force_n in recorded(Random(12), 6.0):
        identifier.observe(stamp_ns, position_m, force_n + 0.05 * (stamp_ns - START_NS) * 1e-9)
    estimate, predictor = identifier.estimate(), ContactPredictor(model, 40.0)
    for i in range(5900, 6000):
        x, v, _ = motion(i * 1e-3)
        predicted_n = predictor.predict(START_NS + i * MS, x, v, estimate)
    assert predicted_n == pytest.approx(linear_force_n(5.999) + 0.05 * 5.999, abs=0.01)
