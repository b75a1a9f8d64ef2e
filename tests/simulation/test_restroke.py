"""Grip, push, release, draw back, grip again: every stroke inserts the instrument further."""

from forefeel.common.messages import Grip
from forefeel.common.topics import FORCE
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from tests.network import traffic_of


def test_a_commanded_restroke_inserts_further_and_each_grip_is_a_new_contact() -> None:
    plan = make_plan(LoopbackOptions(seed=1, impairment="lan", duration_s=9.5))
    plan.master["axes"][0]["handle"]["restroke"] = True
    loop = VirtualLoopback(plan, seed=1)
    loop.run(lambda _done_s: None)
    samples = traffic_of(loop).messages(FORCE)
    grips = [s.gripper for s in samples]
    openings = [i for i in range(1, len(grips)) if (grips[i - 1], grips[i]) == (Grip.CLOSED, Grip.OPEN)]
    closings = [i for i in range(1, len(grips)) if (grips[i - 1], grips[i]) == (Grip.OPEN, Grip.CLOSED)]
    assert len(openings) == 2
    assert len(closings) == 1
    # let go, the load cell soon feels its own bias and noise only, while the stage draws back
    released = samples[openings[0] + 50 : closings[0]]
    assert max(abs(s.force_n - 0.01) for s in released) < 0.02
    assert released[0].position_m - released[-1].position_m > 0.02
    # two pushes, though the stage never went beyond one stroke: the second meets more friction than the first
    starts = (0, closings[0])
    pushed_m = [samples[i].position_m - samples[j].position_m for i, j in zip(openings, starts, strict=True)]
    assert sum(pushed_m) > 1.5 * max(s.position_m for s in samples)
    first_n, second_n = (max(s.force_n for s in samples[j:i]) for i, j in zip(openings, starts, strict=True))
    assert second_n > 1.1 * first_n
