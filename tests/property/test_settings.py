"""Whatever stands at whatever place of a settings file is taken, or refused in one line."""

from collections.abc import Iterator
from copy import deepcopy
from datetime import date
from math import inf, nan
from typing import Any

import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from forefeel.common.config import Settings, checked, dump_yaml
from forefeel.common.errors import ConfigurationError
from forefeel.master.settings import MasterSettings
from forefeel.network_settings import ObserverSettings, RouterSettings
from forefeel.report.vessel import VesselSettings
from forefeel.slave.settings import SlaveSettings

GRIPPER, LISTEN = {"driver": "simulated"}, {"listen": ["tcp/127.0.0.1:1"]}
ZABER = {"driver": "zaber_ascii", "port": "p", "microstep_m": 1e-7, "travel_m": [-0.01, 0.13]}
CAN = {"can": {"interface": "slcan", "channel": "c"}, "node_id": 1}
DRIVE = {"driver": "cia402", "counts_per_m": 1e6, "travel_m": [-0.01, 0.13], **CAN}
CELL = {"full_scale_n": 20.0, "pushes_only": True, "filter_lag_s": 0.0}
STRAIN = {"driver": "cia404", **CAN, **CELL}
LINE = {"driver": "ascii_line", "port": "q", "unit": "counts", "full_scale_native": 1e6, **CELL}
COIL = {"driver": "coil_serial", "port": "h", "counts_per_m": 1e6, "newton_per_ampere": 5, "max_current_a": 1}
HIDDEN = {"hidden": {"effects": {"schema": "forefeel.model/1", "name": "x", "effects": [{"effect": "bias"}]}}}
FILES: list[tuple[type[Settings], dict[str, Any]]] = [
    (SlaveSettings, {"axes": [{"stage": ZABER, "load_cell": LINE, "gripper": GRIPPER}]}),
    (SlaveSettings, {"axes": [{"stage": DRIVE, "load_cell": STRAIN, "gripper": GRIPPER}]}),
    (SlaveSettings, {"axes": [{"simulation": HIDDEN}], "impairment": {"inbound": "lan"}}),
    (MasterSettings, {"axes": [{"handle": COIL}]}),
    (MasterSettings, {"axes": [{"handle": {"driver": "operator"}}]}),
    (ObserverSettings, {"role": "viewer", "transport": LISTEN}),
    (RouterSettings, {"cells": ["a"], "transport": LISTEN}),
    (VesselSettings, {"instrument_radius_mm": 0.9, "lumen_radius_mm": {0: 3.0, 40: 2.0}}),
]  # fmt: skip
SCALARS = [
    None, True, -1, 0, 1 << 1300, 1e308, nan, inf, "", "a\0b", "x" * 5000, "a/" * 3000, "\n", "*", "/",
    "\ud800", b"\xff", date(2020, 1, 1),
]  # fmt: skip
KEYS = "preset", "model", "driver", "schema", "effects", "effect", "parameters", "name", 1, None, nan
HOSTILE = st.recursive(
    st.sampled_from(SCALARS),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=2),
    max_leaves=4,
)


def places(value: object, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield place
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in inside:
        yield from places(child, (*place, key))


WHOLE = [(kind, yaml.safe_load(dump_yaml(checked(kind, data, "f")))) for kind, data in FILES]
PLACES = [(kind, data, place) for kind, data in WHOLE for place in places(data) if place]


@settings(max_examples=1000)
@given(st.sampled_from(PLACES), HOSTILE)
def test_whatever_stands_at_a_place_is_taken_or_refused_in_one_line(
    there: tuple[type[Settings], dict[str, Any], tuple[Any, ...]], hostile: object
) -> None:
    kind, data, (*outer, last) = there
    changed = deepcopy(data)
    inner: Any = changed
    for key in outer:
        inner = inner[key]
    inner[last] = hostile
    try:
        checked(kind, changed, "f")
    except ConfigurationError as error:
        assert str(error).startswith("f: ")
        assert len(str(error).splitlines()) == 1
        assert str(error).encode()
