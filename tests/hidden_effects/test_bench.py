"""The bench itself: what it draws, how it measures, and that its bodies stick, rest and rebound."""

from dataclasses import replace
from math import exp

import numpy as np
import pytest

from tests.hidden_effects.answers import Answer
from tests.hidden_effects.bench import FAMILIES, LEAST_SHARE, Population, draw, family_of
from tests.hidden_effects.bench.effects import KNOWN, Effect, drive_play
from tests.hidden_effects.bench.made import changed, visibility
from tests.hidden_effects.bench.measure import Bench, Sensor, Take, read
from tests.hidden_effects.bench.rig import Body, Link, Rig, Wall, contact, simulated
from tests.hidden_effects.bench.score import Outcome, elsewhere
from tests.hidden_effects.bench.stage import STEP_S, Array, Stage

_CELL = Link(*contact(0.1, 400.0, 0.4))
_NO_WALL = Wall(0.0, 0.0)


def to_and_fro(length_m: float = 5e-3, duration_s: float = 4.0, hold_s: float = 0.5) -> Stage:
    """Smooth strokes between 0 and `length_m` with a hold at either end."""
    t = np.asarray(STEP_S * np.arange(round(duration_s / STEP_S)), dtype=np.float64)
    phase = np.mod(t, 2.0) / (1.0 - hold_s)
    way = np.clip(np.where(phase < 1.0 / (1.0 - hold_s), phase, 1.0 / (1.0 - hold_s) + 1.0 - phase), 0.0, 1.0)
    x = length_m * way**3 * (10.0 - 15.0 * way + 6.0 * way**2)
    return stage_of(t, x)


def stage_of(t: Array, x: Array) -> Stage:
    v = np.asarray(np.gradient(x, STEP_S), dtype=np.float64)
    return Stage(t, x, v, np.asarray(np.gradient(v, STEP_S), dtype=np.float64))


def a_bench(stage: Stage) -> tuple[Bench, Take]:
    ideal_n = 0.1 * stage.a + stage.v + 100.0 * stage.x
    rig = Rig((Body(0.1),), (_CELL,), Wall(100.0, 0.0, 1.0, 1.0))
    noise_n = 1e-3 * np.random.default_rng(1).standard_normal(1000)
    bench = Bench(stage, rig, Sensor(), 4.0, 1e-3, float(np.std(ideal_n)), float(np.max(ideal_n)))
    return bench, Take(np.linspace(0.0, 3.9, 1000), 256.0, noise_n, 1e-6, 1, "")


def stuck(velocity: Array) -> Array:
    return np.asarray(velocity == 0.0)


_SHORT = {Population.COMPOSITIONS: 30, Population.SLOW: 6, Population.HUM: 13, Population.NOTHING: 1}
_DIAGNOSED = {Population.KNOWN, Population.PLAY, Population.ODD}
"""Seeds of recordings of some 11 s, and those of which test_quick_set.py diagnoses some."""


def test_every_population_has_recordings() -> None:
    assert {*_SHORT} | _DIAGNOSED == {*Population}
    for population, seed in _SHORT.items():
        made = draw(population, seed)
        columns = made.time_s, made.position_m, made.force_n
        assert all(np.all(np.isfinite(column)) for column in columns)
    again = draw(population, seed)
    assert np.array_equal(made.force_n, again.force_n) and np.array_equal(made.position_m, again.position_m)
    assert made.description == again.description


def test_every_known_effect_has_one_name_and_its_family() -> None:
    (bench, _), rng = a_bench(to_and_fro()), np.random.default_rng(1)
    made = [maker(rng, bench) for maker in KNOWN]
    named = {effect.name for effects in made for effect in effects}
    assert all(effects[0].families == {family_of(effects[0].name)} for effects in made)
    assert len(made) == sum(map(len, made)) and named == {
        name for names in FAMILIES.values() for name in names
    } - {"bias", "backlash", "gravity_load"}
    assert family_of("backlash") == family_of("play") == "play"
    assert family_of("warp") == "warp"


def test_static_friction_holds_without_any_slip() -> None:
    """2 um of stage against the cell's spring are less than what sticks; then 5 mm are far more."""
    body = Body(0.1, coulomb_n=1.5, static_n=2.0, stribeck_m_s=1e-3)
    rig = Rig((body,), (_CELL,), _NO_WALL)
    held = simulated(rig, to_and_fro(2e-6))
    assert _CELL.stiffness_n_m * 2e-6 < body.static_n
    assert np.all(stuck(held.v[0])) and np.all(held.x[0] == held.x[0, 0])
    assert np.max(np.abs(held.cell_n)) > 0.5
    moved = simulated(rig, to_and_fro())
    resting = slice(round(0.8 / STEP_S), round(0.99 / STEP_S))
    assert np.all(stuck(moved.v[0, resting])) and np.ptp(moved.x[0, resting]) == 0.0
    assert np.max(moved.x[0]) > 4.9e-3


def test_sliding_costs_coulomb_friction() -> None:
    stage = to_and_fro()
    run = simulated(Rig((Body(0.1, coulomb_n=0.3, static_n=0.3),), (_CELL,), _NO_WALL), stage)
    forward = stage.v > 2e-3
    assert run.cell_n[forward] - 0.1 * stage.a[forward] == pytest.approx(0.3, abs=0.05)


def test_the_body_behind_rests_while_the_gap_is_crossed() -> None:
    stage, gap_m = to_and_fro(), 1e-3
    bench, _ = a_bench(stage)
    (play,) = drive_play(np.random.default_rng(1), bench)
    rig = play.change(bench).rig
    rig = rig._replace(links=(rig.links[0]._replace(gap_m=gap_m), *rig.links[1:]))
    run = simulated(rig, stage)
    inside = (np.abs(stage.x - run.x[0]) < 0.45 * gap_m) & (stage.t > 0.2) & (np.abs(stage.v) > 1e-4)
    assert np.count_nonzero(inside) > 100
    assert np.mean(stuck(run.v[0, inside])) > 0.95
    assert np.max(np.abs(stage.x - run.x[0])) < 0.55 * gap_m


@pytest.mark.parametrize("restitution", [0.3, 0.7])
def test_an_impact_gives_back_its_share_of_the_speed(restitution: float) -> None:
    """A free body between the ends of its gap, hit by a stage that starts at once and goes on."""
    t = np.asarray(STEP_S * np.arange(2000), dtype=np.float64)
    speed, gap_m = 0.1, 2e-3
    stage = stage_of(t, np.asarray(speed * t))
    link = Link(*contact(0.1, 300.0, restitution), gap_m)
    run = simulated(Rig((Body(0.1),), (link,), _NO_WALL), stage)
    assert np.max(run.v[0, :700]) == pytest.approx((1.0 + restitution) * speed, rel=0.1)


def test_a_capstan_is_a_factor_on_the_tips_force() -> None:
    stage = to_and_fro()
    run = simulated(Rig((Body(0.02),), (_CELL,), Wall(200.0, -1e-3, capstan=0.5)), stage)
    tip_n = 200.0 * (stage.x + 1e-3)
    for moving, factor in ((stage.v > 5e-3, exp(0.5)), (stage.v < -5e-3, exp(-0.5))):
        assert np.median(run.cell_n[moving] / tip_n[moving]) == pytest.approx(factor, rel=0.03)


def test_without_an_effect_the_force_is_that_of_mass_damper_and_spring() -> None:
    stage = to_and_fro()
    bench, _ = a_bench(stage)
    ideal_n = 0.1 * stage.a + stage.v + 100.0 * stage.x
    assert simulated(bench.rig, stage).cell_n == pytest.approx(ideal_n, abs=0.02 * bench.peak_n)


def test_what_can_not_be_seen_is_not_shown() -> None:
    bench, take = a_bench(to_and_fro())
    weak = Effect("", "", lambda b: b.with_tip(coulomb_n=1e-3, static_n=1e-3))
    strong = Effect("", "", lambda b: b.with_tip(coulomb_n=0.1, static_n=0.1))
    stiffer = Effect("", "", lambda b: b.with_wall(stiffness_n_m=150.0))

    def share(*effects: Effect) -> float:
        return visibility(bench, take, effects, read(changed(bench, effects), take))

    assert share(weak) < LEAST_SHARE < share(strong)
    assert share(strong, weak) < LEAST_SHARE
    assert share(stiffer) < LEAST_SHARE


def test_outcomes() -> None:
    truth = frozenset({"play"})
    outcome = Outcome(Population.PLAY, 0, truth, truth, True, "", Answer("cause_found", ("backlash",)))
    partly = replace(outcome, answer=Answer("partly_explained", ("backlash",)))
    for right in (outcome, partly):
        assert right.exact and right.right_first and not right.wrong_first
    wrong = replace(outcome, answer=Answer("partly_explained", ("sensor_lag", "backlash")))
    assert wrong.wrong_first and wrong.answer.partly and not wrong.exact and not wrong.abstained
    assert replace(outcome, answer=Answer("nothing_missing")).missed
    unnamed = replace(outcome, names=frozenset[str](), answer=Answer("unexplained"))
    assert unnamed.exact and unnamed.abstained
    assert replace(outcome, hides=False, answer=Answer("nothing_missing")).exact


def test_gain_on_another_motion_is_within_its_interval() -> None:
    found = elsewhere(Population.KNOWN, 303)
    assert found is not None
    assert found.expected is not None
    assert found.holds
    assert found.confirmation.verdict == "confirmed"
    assert found.expected.gain_high - found.expected.gain_low < 0.95
