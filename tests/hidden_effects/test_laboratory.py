"""The laboratory's recordings are what their truth says; its scoring tells falsehood from caution."""

from typing import Any

import numpy as np
import pytest

from tests.hidden_effects.laboratory import KINDS, draw
from tests.hidden_effects.laboratory.machines import joint
from tests.hidden_effects.laboratory.score import judge
from tests.hidden_effects.laboratory.truth import Recorded


def check_two_motions(recorded: Recorded) -> None:
    """Two sane motions of one world that are not the same."""
    second = recorded.second
    assert second is not None
    assert second.truth == recorded.truth
    for run in (recorded, second):
        assert 380 < len(run.time_s) <= 30_000
        assert np.all(np.diff(run.time_s) > 0.0)
        assert np.all(np.isfinite(run.force)) and np.ptp(run.position) > 0.0
    count = min(len(recorded.position), len(second.position))
    far_m = 0.01 * float(np.ptp(recorded.position))
    assert not np.allclose(recorded.position[:count], second.position[:count], atol=far_m)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_gives_the_same_two_motions_again_with_noise_and_rest_of_the_stated_size(kind: str) -> None:
    one, again, other = draw(kind, 5), draw(kind, 5), draw(kind, 6)
    assert one.truth == again.truth != other.truth
    assert np.array_equal(one.force, again.force) and np.array_equal(one.position, again.position)
    for recorded in (one, other):
        check_two_motions(recorded)
        left = recorded.force - recorded.force_clean
        assert np.std(left) > 0.8 * np.hypot(recorded.truth.noise_n, recorded.truth.left_n)


def test_a_bare_joint_is_gravity_inertia_and_viscosity_in_both_motions() -> None:
    worlds = [joint(np.random.default_rng(seed)) for seed in range(40)]
    bare = [world for world in worlds if set(world.parts[0]) == {"", "angle_force"}]
    assert bare
    for world in bare:
        n = world.numbers
        for m, parts in zip(world.motions, world.parts, strict=True):
            torque = n["inertia"] * m.a + n["viscous"] * m.v + n["gravity"] * np.sin(m.x - n["offset"])
            assert np.allclose(sum(parts.values()), torque)


def _truth(**changes: Any) -> dict[str, Any]:  # noqa: ANN401
    truth = {
        "kind": "strokes", "seed": 0, "motion": "", "names": [["coulomb_friction", 0.5]], "allowed": [],
        "separable": True, "mass": None, "damping": None, "stiffness": -50.0, "parameters": [], "hidden": 0.5,
        "force_n": 1.0, "left_n": 0.02, "noise_n": 0.02, "outside": False, "travel": 0.02,
    }  # fmt: skip
    return {**truth, **changes}


def _answer(verdict: str, *names: str, stiffness: float = -50.0) -> dict[str, Any]:
    causes = [{"name": name, "gain_n": 0.5**i, "parameters": {}} for i, name in enumerate(names)]
    told = {"stiffness_n_m": [stiffness, stiffness - 5.0, stiffness + 5.0]}
    return {"verdict": verdict, "causes": causes, "rivals": [], "base": told}


@pytest.mark.parametrize(
    ("answer", "found"),
    [
        (_answer("cause_found", "stribeck_friction"), "right"),
        (_answer("partly_explained", "coulomb_friction", "bias"), "right"),
        (_answer("cause_found", "coulomb_friction", "pulsation"), "false"),
        (_answer("cause_found", "coulomb_friction", stiffness=50.0), "false"),
        (_answer("cause_found", "bias"), "false"),
        (_answer("nothing_found"), "false"),
        (_answer("unexplained"), "timid"),
    ],
)
def test_an_answer_is_judged(answer: dict[str, Any], found: str) -> None:
    assert judge(_truth(), answer).found == found


def test_an_abstention_is_right_where_nothing_else_could_be() -> None:
    pulled = _truth(kind="pull", separable=False, names=[["stiffening", 0.3]], stiffness=None)
    assert judge(pulled, _answer("unexplained")).found == "right"
    assert judge(pulled, _answer("cause_found", "sensor_drift")).found == "false"
    assert judge(_truth(names=[["coulomb_friction", 0.05]]), _answer("unexplained")).found == "honest"
