"""Another day and another patient: what is drawn for the simulated world."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from forefeel.common.causes.model import ContactModel
from forefeel.loopback.plan import LoopbackOptions, make_plan
from forefeel.slave.plant.settings import preset
from forefeel.slave.plant.variation import varied


def parameters(model: ContactModel) -> Iterator[tuple[str, float]]:
    """(effect's place, name and parameter; value) of each."""
    for place, entry in enumerate(model.effects):
        for name, value in entry.parameters:
            yield f"{place} {entry.effect} {name}", value


@pytest.mark.parametrize(("spread", "shift_m", "rate"), [(0.05, 0.0005, 0.10), (0.4, 0.003, 0.25)])
def test_draws_fill_their_range_and_no_more(spread: float, shift_m: float, rate: float) -> None:
    model = preset("catheter").contact
    drawn = [dict(parameters(varied(model, spread, seed))) for seed in range(200)]
    for name, value in parameters(model):
        found = [each[name] for each in drawn]
        middle, reach = value, spread * value
        if name.endswith("contact_position_m"):
            reach = shift_m
        elif name.endswith("band_m_s"):
            reach = 0.0
        elif name.endswith("frequency_hz"):
            reach = rate * value
        elif name.endswith("pulsation phase_rad"):
            middle, reach = 0.0, 3.1416
        assert middle - reach <= min(found) <= middle - 0.9 * reach, name
        assert middle + 0.9 * reach <= max(found) <= middle + reach, name


def test_seed_decides() -> None:
    model = preset("guidewire").contact
    assert varied(model, 0.05, 3) == varied(model, 0.05, 3) != varied(model, 0.05, 4)


def test_drawn_world_is_used_and_recorded() -> None:
    options = LoopbackOptions(preset="guidewire")
    plan = make_plan(replace(options, world_spread=0.4, world_seed=7))
    drawn = varied(preset("guidewire").contact, 0.4, 7)
    assert plan.slave_settings().axes[0].simulation.contact == drawn
    assert plan.metadata["world_spread"] == "0.4, world seed 7"
    assert plan.master == make_plan(options).master
