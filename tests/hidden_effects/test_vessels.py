"""The engine of the vessels is trusted by formulas; its recordings are what their truth says."""

from math import exp, pi, radians

import numpy as np
import pytest

from forefeel.devices.mujoco.path import GUIDE_M, Path, Piece
from forefeel.devices.mujoco.wire import STEP_S, EscapedError, Guidewire, WireChain
from tests.hidden_effects.laboratory.score import judge
from tests.hidden_effects.vessels import draw
from tests.hidden_effects.vessels.draw import KINDS, drawn_path

_HALF_M = 1.25e-3


def _bend(curvature: float, angle: float) -> Path:
    """A straight, a bend and a straight."""
    return Path(
        (Piece(0.02, 0.0, _HALF_M), Piece(angle / curvature, curvature, _HALF_M), Piece(0.05, 0.0, _HALF_M))
    )


@pytest.mark.parametrize("segment_m", [2e-3, 4e-3])
def test_a_cantilever_bends_by_p_l3_over_3_ei(segment_m: float) -> None:
    length_m, load_n, stiffness = 0.06, 1e-3, 1e-4
    world = Guidewire(WireChain(stiffness, 2e-4, length_m, segment_m, soft_tip=False), None, 0.1)
    world.data.xfrc_applied[-1, [1, 5]] = load_n, 0.5 * load_n * segment_m  # at the end of the last segment
    for _ in range(round(1.5 / STEP_S)):
        world.step(0.0, 0.0)
    assert world.nodes[-1, 1] == pytest.approx(load_n * length_m**3 / (3.0 * stiffness), rel=0.01)


@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_a_wire_pulled_round_a_bend_gains_exp_mu_theta(friction: float) -> None:
    pulled_n, speed, angle = 0.2, 0.01, 0.5 * pi
    wire = WireChain(5e-5, 2e-4, 0.05 + 0.03 * angle, 3e-3, soft_tip=False)
    world = Guidewire(wire, _bend(1.0 / 0.03, angle), friction)
    pulls = []
    for i in range(-1, round(0.4 / STEP_S)):
        last = world.nodes[-1] - world.nodes[-2]
        world.data.xfrc_applied[-1, :2] = pulled_n * last / np.hypot(*last)
        if i < 0:
            world.settle()  # on the inner wall
        else:
            pulls.append(-world.step(-speed * i * STEP_S, -speed))
    turned = np.arctan2(last[1], last[0])
    assert turned == pytest.approx(angle, abs=0.1)
    assert np.mean(pulls[-400:]) == pytest.approx(pulled_n * exp(friction * turned), rel=0.05)


def test_a_wire_that_rests_stays_where_friction_holds_it() -> None:
    world = Guidewire(WireChain(2e-4, 2.5e-4, 0.1, 3e-3), _bend(1.0 / 0.03, radians(80.0)), 0.2)
    world.settle()
    for i in range(round(0.2 / STEP_S)):
        world.step(0.02 * i * STEP_S, 0.02)
    held = [world.step(0.004, 0.0) for _ in range(round(0.5 / STEP_S))]
    assert held[-1] > 0.02
    assert held[-1] == pytest.approx(held[len(held) // 2], rel=0.03)


def test_a_wire_that_leaves_its_vessel_is_refused() -> None:
    world = Guidewire(WireChain(5e-4, 3e-4, 0.1, 3e-3), _bend(1.0 / 0.008, radians(170.0)), 0.2)
    with pytest.raises(EscapedError, match="outside"):
        for _ in range(200):
            world.step(0.0, 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_vessel_has_both_walls_all_along_and_none_within(kind: str) -> None:
    lumen_m = KINDS[kind].lumen_m[0]
    for seed in range(5):
        path = drawn_path(np.random.default_rng(seed), 0.03, 0.12, lumen_m, KINDS[kind].bends_m)
        line = path.line[50:-50:5]
        bars = np.array(list(path.bars()))
        along, from_ = bars[:, 2:4] - bars[:, :2], line[:, None] - bars[None, :, :2]
        share = np.clip(np.sum(from_ * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0)
        off = from_ - share[..., None] * along
        near = np.hypot(off[..., 0], off[..., 1]) - bars[:, 4]
        assert np.min(near) > 0.5 * GUIDE_M - 5e-5
        tangent = np.gradient(line, axis=0)[:, None]
        left = tangent[..., 0] * off[..., 1] < tangent[..., 1] * off[..., 0]
        for side in (left, ~left):
            assert np.max(np.min(np.where(side, near, 1.0), axis=1)) < 0.5 * lumen_m + 5e-5


def test_the_engine_gives_the_same_again() -> None:
    def pushed() -> list[float]:
        world = Guidewire(WireChain(2e-4, 2.5e-4, 0.1, 3e-3), _bend(1.0 / 0.03, radians(80.0)), 0.2)
        world.settle()
        return [world.step(0.02 * i * STEP_S, 0.02) for i in range(200)]

    assert pushed() == pushed()


def test_a_recording_holds_its_noise_and_is_judged_by_its_truth() -> None:
    one = draw("wide", 10, (1.0, 1.0))
    assert one.second is not None and not np.allclose(one.position, one.second.position, atol=1e-3)
    assert np.std(one.force - one.force_clean) == pytest.approx(one.truth.noise_n, rel=0.3)
    truth = {**vars(one.truth), "travel": 0.02}
    for name, found in ((one.truth.names[0][0], "right"), ("sensor_lag", "false")):
        causes = [{"name": name, "gain_n": 1.0, "parameters": {}}]
        answer = {"verdict": "cause_found", "causes": causes, "rivals": [], "base": {}}
        assert judge(truth, answer).found == found
