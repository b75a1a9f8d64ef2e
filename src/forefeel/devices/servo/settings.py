"""YAML settings of a handle that another program moves."""

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from forefeel.common.config import beside_the_file
from forefeel.master.handle import HandleDriverSettings


class ServoSettings(HandleDriverSettings):
    """`socket`: a path, made for this user alone. The deadman is pressed while positions come there, and let
    go `stale_s` after the last one.
    """

    hardware: ClassVar[bool] = False
    driver: Literal["servo"]
    socket: Annotated[Path, AfterValidator(beside_the_file)]
    stale_s: Annotated[float, Field(ge=0.02, le=0.5)] = 0.1
