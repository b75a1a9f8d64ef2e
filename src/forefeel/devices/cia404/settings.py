"""YAML settings of a CiA 404 force transducer."""

from typing import Annotated, Literal

from pydantic import Field

from forefeel.devices.shared.settings import CanSettings, CellSettings, NodeId


class Cia404Settings(CellSettings):
    """A CiA 404 force transducer: process value (REAL32, of force) and status in one TPDO at every SYNC."""

    driver: Literal["cia404"]
    can: CanSettings
    node_id: NodeId
    rate_hz: Annotated[float, Field(ge=1, le=1000)] = 250.0
