"""A wire that slips through the jaws or is about to bow out: said by the slave, and no stop."""

from typing import Any

import numpy as np
import pytest

from forefeel.common.causes.gripper import GripperSlip
from forefeel.common.causes.model import SCHEMA
from forefeel.common.events.text import BUCKLES, LOOSENS, SLIPS
from forefeel.common.messages import SafetyState
from forefeel.common.topics import LIMIT_EVENT, SLAVE_STATE
from forefeel.simulate.motion import Hand
from forefeel.slave.instrument import InstrumentWatch
from forefeel.slave.plant.settings import world_settings
from forefeel.slave.plant.world import SimulatedWorld
from forefeel.slave.settings import InstrumentSettings
from forefeel.slave.stage import StageReading
from tests.simulation.pair import Pair, S

_FROM_S, _LASTS_S = 8.0, 20.0
Told = tuple[float, str, float]
"""Time in s, rule, and the way in m that the wire has slipped by then."""


def _told(preset: str, seed: int, slip: dict[str, float] | None = None, **loads: float) -> list[Told]:
    """Warnings while a hand moves a simulated instrument, in whose jaws it slips from _FROM_S on."""
    settings: dict[str, Any] = {"preset": preset}
    if slip is not None:
        effects = [{"effect": "gripper_slip", "parameters": slip}]
        settings["hidden"] = {
            "effects": {"schema": SCHEMA, "name": "slip", "effects": effects},
            "from_s": _FROM_S,
        }
    world = SimulatedWorld(world_settings(settings), seed)
    watch, told = InstrumentWatch(InstrumentSettings(**loads)), list[Told]()
    acting = vars(vars(world._fixture._contact).get("_after", world._fixture._contact))["_effects"]
    slips = [effect for effect in acting if isinstance(effect, GripperSlip)]
    hand = Hand(0.0, 0.1, _LASTS_S, np.random.default_rng(seed))
    t = np.arange(round(_LASTS_S * 1e3), dtype=np.float64) * 1e-3
    slipped_m = before_m = 0.0
    for now_s, x_m, v_m_s in zip(t.tolist(), *(c.tolist() for c in hand.at(t)[:2]), strict=True):
        now_ns = round(now_s * S)
        world.set_target(x_m, v_m_s, now_ns)
        reading = world.load_cell_reading()
        if slips:
            slipped_m = vars(slips[0])["slip"].__self__.value[0]
            before_m = slipped_m if now_s <= _FROM_S else before_m
        stage = StageReading(*world.stage_readback())
        hits = watch.take(now_ns, stage, reading.force_n, reading.valid, True)
        told += [(now_s, hit.rule, slipped_m - before_m) for hit in hits]
    return told


@pytest.mark.parametrize(("preset", "holding_n", "seed"), [("catheter", 0.3, 3), ("guidewire", 0.025, 5)])
def test_a_slip_is_said_before_a_millimetre_is_lost(preset: str, holding_n: float, seed: int) -> None:
    told = _told(preset, seed, {"holding_n": holding_n, "slipped_m": 1.2e-3})
    assert told[0][0] > _FROM_S
    assert {rule for _, rule, _ in told} == {SLIPS}
    assert 0.0 < told[0][2] < 1e-3


@pytest.mark.parametrize("preset", ["catheter", "guidewire"])
def test_nothing_is_said_of_an_instrument_that_holds(preset: str) -> None:
    assert _told(preset, 5) == []


def test_a_load_that_is_known_is_said_before_it_is_reached_and_once_each_time() -> None:
    told = _told("catheter", 5, holding_n=0.6, euler_n_m2=0.7 * 0.05**2, free_length_m=0.1)
    assert {rule for _, rule, _ in told} == {BUCKLES, LOOSENS}
    assert 2 <= len(told) < 20


def test_a_warning_is_an_event_and_in_the_state_and_stops_nothing() -> None:
    pair = Pair()
    axis = pair.slave.axes[0]
    vars(axis)["_instrument"] = InstrumentWatch(InstrumentSettings(holding_n=0.1))
    pair.run(2.5)
    rules = [event.rule for event in pair.traffic.messages(LIMIT_EVENT)]
    states = list(pair.traffic.messages(SLAVE_STATE))
    assert LOOSENS in rules
    assert {state.near_load for state in states} == {None, LOOSENS}
    assert states[-1].state is SafetyState.ARMED
