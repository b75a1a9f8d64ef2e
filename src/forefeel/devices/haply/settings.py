"""YAML settings of an Inverse3."""

from math import sqrt
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from forefeel.master.handle import HandleDriverSettings


def _unit(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = direction
    length = sqrt(x * x + y * y + z * z)
    if length == 0.0:
        raise ValueError("expected a direction such as [0, 1, 0]")
    return x / length, y / length, z / length


_Component = Annotated[float, Field(ge=-1, le=1)]
_Button = Annotated[str, Field(min_length=1, max_length=32)]


class HaplySettings(HandleDriverSettings):
    """An Inverse3 with a Verse Grip behind their maker's service; one direction of three is used.

    `direction`: of the insertion, in the coordinates of the device; `device_id`: which, where the service has
    several; `deadman`, `gripper`: buttons of the grip. The force is clamped to `max_force_n`.
    """

    driver: Literal["haply"]
    url: Annotated[str, Field(pattern=r"^wss?://[^\s/?#]+/?$", max_length=256)] = "ws://localhost:10001"
    device_id: Annotated[str, Field(min_length=1, max_length=32)] | None = None
    direction: Annotated[tuple[_Component, _Component, _Component], AfterValidator(_unit)] = (0.0, 1.0, 0.0)
    deadman: _Button = "a"
    gripper: _Button = "b"
    rate_hz: Annotated[float, Field(ge=100, le=1000)] = 200.0
    max_force_n: Annotated[float, Field(gt=0, le=10)] = 2.0
    actuator_delay_s: Annotated[float, Field(ge=0.001, le=0.02)] = 0.01
    """Two periods. Of a real device nobody has measured it."""
    watchdog_s: Annotated[float, Field(ge=0.02, le=0.1)] = 0.05
