"""A guidewire by MuJoCo as the world of a cell."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from forefeel.common.errors import ConfigurationError
from forefeel.common.messages import SafetyState
from forefeel.common.recording.mcap_reader import Run
from forefeel.common.topics import FORCE, SLAVE_STATE
from forefeel.loopback.plan import AXIS, OUR_WORLDS, LoopbackOptions, Plan, make_plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.report.page import still
from forefeel.report.traces import axis_traces
from tests.looped import looped
from tests.network import traffic_of


def plan(world: str, duration_s: float) -> Plan:
    return make_plan(LoopbackOptions(world=world, duration_s=duration_s))


def test_cell_in_a_vessel_of_mujoco_arms_and_shows_the_wire_in_it(tmp_path: Path) -> None:
    """That the engine gives the same again is in hidden_effects/test_vessels.py."""
    loop = looped(plan("coronary", 3.0))
    traffic = traffic_of(loop)
    assert np.ptp(traffic.column(FORCE, "force_n")) > 0.02
    assert traffic.armed_share(until_s=4.0) > 0.99
    assert traffic.newest(SLAVE_STATE).stops == 0
    loop.write(tmp_path / "run.mcap")
    recorded = Run(tmp_path / "run.mcap")
    figure = still(recorded, AXIS, axis_traces(recorded, AXIS))
    assert figure is not None
    (spec,) = figure.specs
    walls, shape = np.array([*spec["vessel"]["walls_mm"].values()]), np.array(spec["shape_mm"])
    assert shape.shape == (24, 2)
    middle = 0.5 * (walls[:, :2] + walls[:, 2:])
    assert min(np.hypot(*(middle - shape[-1]).T)) < 1.5  # the tip is in the lumen


def test_wire_that_leaves_its_vessel_is_a_fault_of_the_slave(tmp_path: Path) -> None:
    file = yaml.safe_load((OUR_WORLDS / "coronary.yaml").read_text())
    world = file["simulation"]["world"]
    # a bend of 6 mm that a wire of that stiffness does not follow, with a force that pushes it through
    world["pieces"] = [{"length_m": 0.006}, {"radius_m": 0.006, "turn_deg": 170}, {"length_m": 0.2}]
    world["wire"]["stiffness_n_m2"] = 1e-3
    file["simulation"]["load_cell"] = {"full_scale_n": 20.0}
    file["limits"]["max_force_n"] = 15.0
    (tmp_path / "tight.yaml").write_text(yaml.safe_dump(file))
    last = traffic_of(looped(plan(str(tmp_path / "tight.yaml"), 3.0))).newest(SLAVE_STATE)
    assert last.state is SafetyState.FAULT
    assert "mm outside at" in last.reason


def test_vessel_that_can_not_be_is_refused(tmp_path: Path) -> None:
    file = yaml.safe_load((OUR_WORLDS / "coronary.yaml").read_text())
    world, straight = file["simulation"]["world"], [{"length_m": 0.9}]
    fine, none = {"inserted_m": 0.4, "guide_m": 0.2}, {"inserted_m": 5e-4, "guide_m": 5e-4}
    wire = {**world["wire"], "segment_m": 1e-3}
    for changed, message in (
        ({"pieces": [{"length_m": 0.05}]}, "expected .* what the wire reaches"),
        ({"pieces": [{"radius_m": 0.003, "turn_deg": 90}]}, r"radius_m = 0\.003; expected at least 0\.0045"),
        ({"pieces": [{"radius_m": 0.01, "turn_deg": 270}, {"length_m": 0.2}]}, "crosses itself"),
        (
            {"pieces": straight, "wire": wire, **fine},
            r"segment_m = 0\.001: 600 segments on .*expected 1 to 495",
        ),
        ({"pieces": straight, **none}, "0 segments on .*expected 1 to 495"),
        ({"pieces": [{"radius_m": 0.05, "turn_deg": 1e-300}, *straight]}, "world vessel: can not be made"),
    ):
        file["simulation"]["world"] = world | changed
        (tmp_path / "no.yaml").write_text(yaml.safe_dump(file))
        with pytest.raises(ConfigurationError, match=message):
            VirtualLoopback(plan(str(tmp_path / "no.yaml"), 1.0), 1)
    with pytest.raises(ConfigurationError, match="a YAML file, or one of arch, coronary"):
        plan("carotid", 1.0)
