"""The clutch: the handle moves the stage only while the deadman is held; the offset saved on engaging leaves
no jump. Pure.
"""

from forefeel.master.handle import HandleReading


class Clutch:
    """Command = handle + offset. With the clutch open the offset follows, so that the command stays on the
    stage.
    """

    def __init__(self) -> None:
        self.offset_m = 0.0

    def command_m(self, reading: HandleReading, stage_position_m: float | None) -> float:
        """The absolute position to command for a reading; `stage_position_m`: newest known readback, None
        before any.
        """
        if not reading.deadman and stage_position_m is not None:
            self.offset_m = stage_position_m - reading.position_m
        return reading.position_m + self.offset_m
