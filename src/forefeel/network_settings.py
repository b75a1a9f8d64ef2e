"""YAML settings of those who move nothing: recorder, viewer and router."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from forefeel.common.config import Settings, checked, load_settings
from forefeel.common.errors import ConfigurationError, check_config_alone
from forefeel.common.settings import Segment
from forefeel.common.topics import checked_segment
from forefeel.common.transport.settings import TransportSettings


class ObserverSettings(Settings):
    """A program that only receives from a cell: a recorder, or a viewer, which may stop it, too."""

    role: Literal["recorder", "viewer"] = "recorder"
    cell: Segment = "cell"
    transport: TransportSettings

    @model_validator(mode="after")
    def _hears_someone(self) -> Self:
        if not (self.transport.connect or self.transport.listen):
            raise ValueError("transport.connect: expected at least one endpoint as in tls/10.0.0.1:7447")
        if self.transport.connections is not None:
            raise ValueError("transport.connections: expected none, who only watches has a single one")
        return self


class RouterSettings(Settings):
    """The cells that a router serves, its endpoints, and its certificates."""

    role: Literal["router"] = "router"
    cells: Annotated[tuple[Segment, ...], Field(min_length=1)]
    transport: TransportSettings

    @model_validator(mode="after")
    def _listens(self) -> Self:
        """Raises ValueError without `listen`, with `connect` or a mode, or for a cell twice."""
        if not self.transport.listen:
            raise ValueError("transport.listen: expected at least one endpoint as in tls/0.0.0.0:7447")
        if self.transport.connect or self.transport.mode != "peer":
            raise ValueError("transport.connect: expected none and no mode, for a router is connected to")
        if len(set(self.cells)) != len(self.cells):
            raise ValueError(f"cells = {list(self.cells)}: expected each name once")
        return self


def observer(
    config: Path | None,
    cell: str | None,
    connect: Sequence[str],
    pki: Path | None,
    through_router: bool,
) -> ObserverSettings:
    """Loads the settings of a recorder or viewer from the file `config`, or makes them of the other options
    in its place; without `cell` the cell is named `cell`.

    Raises:
        ConfigurationError: both given, neither `config` nor `connect`, or a value that can not be used.
    """
    if config is not None:
        check_config_alone(cell is not None, connect, pki, through_router)
        return load_settings(ObserverSettings, config)
    if not connect:
        raise ConfigurationError("--connect: missing, expected at least one endpoint, or --config FILE")
    name = checked_segment("cell" if cell is None else cell, "--cell")
    mode: Literal["client", "peer"] = "client" if through_router else "peer"
    transport = {"mode": mode, "connect": list(connect), "pki": pki}
    return checked(ObserverSettings, {"cell": name, "transport": transport}, "options")
