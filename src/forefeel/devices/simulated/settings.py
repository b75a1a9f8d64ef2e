"""YAML settings of devices without hardware."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from forefeel.common.settings import ColumnSettings, ExistingFile
from forefeel.devices.shared.settings import Sign
from forefeel.master.handle import HandleDriverSettings
from forefeel.slave.gripper import GripperDriverSettings
from forefeel.slave.load_cell import LoadCellDriverSettings
from forefeel.slave.stage import StageDriverSettings


class SimulatedStageSettings(StageDriverSettings):
    hardware: ClassVar[bool] = False
    driver: Literal["simulated"] = "simulated"


class SimulatedLoadCellSettings(LoadCellDriverSettings):
    """The load cell of the axis' simulated world."""

    hardware: ClassVar[bool] = False
    driver: Literal["simulated"] = "simulated"


class RecordedLoadCellSettings(LoadCellDriverSettings):
    """The force of `recording` at each command's recording time, times `force_sign`: -1 for a recording that
    shows the reaction to the resisting force.
    """

    hardware: ClassVar[bool] = False
    driver: Literal["recorded"]
    recording: ExistingFile
    columns: ColumnSettings | None = None
    force_sign: Sign = 1


class SimulatedGripperSettings(GripperDriverSettings):
    hardware: ClassVar[bool] = False
    driver: Literal["simulated"] = "simulated"


class OperatorSettings(HandleDriverSettings):
    """The synthetic operator: strokes, tremor and arm (arm values: typical of a relaxed hand in one axis).

    `restroke`: withdraws with the fixture open, so that every stroke inserts the instrument further.
    """

    hardware: ClassVar[bool] = False
    driver: Literal["operator"] = "operator"
    home_m: Annotated[float, Field(ge=-1, le=1)] = 0.005
    depth_m: Annotated[float, Field(gt=0, le=0.5)] = 0.030
    insert_s: Annotated[float, Field(ge=0.2, le=60)] = 1.8
    withdraw_s: Annotated[float, Field(ge=0.2, le=60)] = 1.4
    dwell_s: Annotated[float, Field(ge=0, le=60)] = 0.6
    restroke: bool = False
    tremor_m: Annotated[float, Field(ge=0, le=0.005)] = 0.0002
    arm_mass_kg: Annotated[float, Field(gt=0.01, le=20)] = 0.4
    arm_damping_n_s_m: Annotated[float, Field(ge=0, le=200)] = 12.0
    arm_stiffness_n_m: Annotated[float, Field(gt=1, le=5000)] = 250.0
    seed: int = 0


class RecordedHandleSettings(HandleDriverSettings):
    hardware: ClassVar[bool] = False
    driver: Literal["recording"]
    recording: ExistingFile
    columns: ColumnSettings | None = None
    approach_m_s: Annotated[float, Field(gt=0, le=1)] = 0.03
