"""A CiA 404 force transducer behind the load-cell port."""

from datetime import date
from math import isfinite

from forefeel.common.clock import Clock, MonotonicClock
from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.common.hardware.calibration import CellScale, load_cell_calibration
from forefeel.common.hardware.link import LinkState
from forefeel.devices.canopen.cia301 import EMERGENCY, START, SYNC, emergency, pdo_off
from forefeel.devices.canopen.network import SharedNetwork
from forefeel.devices.canopen.sdo import RemoteDevice, can_link, talking_to
from forefeel.devices.cia404 import protocol as cia404
from forefeel.devices.cia404.settings import Cia404Settings
from forefeel.devices.shared.conversation import Conversation, Pacer, Steps
from forefeel.devices.shared.force_scale import ForceScale, Native, StuckWatch
from forefeel.devices.shared.load_cell import QueuedLoadCell

_OPEN_S = 5.0  # s for the handshake
_RANK = 0  # of who sends SYNC on a shared bus: a drive, of rank 1, goes before
# periods without a TPDO that are a fault, but at least so many s (docs/decisions/0014)
_SILENT_PERIODS, _SILENT_S = 10, 0.05


class Cia404LoadCell(QueuedLoadCell):
    """Load-cell port on a CANopen transducer: one reading for each TPDO, at SYNC.

    SYNC comes from the stage's driver where one shares the bus, else from here. Tare and scale are of the
    calibration; without one the unit of the device counts.

    Attributes:
        scale: by the device's unit; None before it is open.

    Raises:
        DeviceError: the device is silent, reports an emergency, or the bus is gone.
    """

    def __init__(self, settings: Cia404Settings, clock: Clock | None = None) -> None:
        self._settings = settings
        self._clock = clock or MonotonicClock()
        link = can_link("load cell", settings.driver, settings.can, settings.node_id)
        super().__init__(link, settings.full_scale_n, max(0.02, 5.0 / settings.rate_hz))
        self._pdo = cia404.reading_pdo(settings.node_id)
        self.scale: CellScale | None = None
        self._tpdos, self._emergency = 0, 0

    def _open_s(self) -> float:
        return _OPEN_S

    # --- the conversation ---

    def _converse(self, conversation: Conversation) -> Steps:
        """Sets the transducer up and receives its readings until the conversation ends; then leaves SYNC."""
        settings = self._settings
        with talking_to(settings.can, settings.node_id, self.link) as (shared, device):
            try:
                self._set_up(device)
                yield from self._exchange(conversation, shared, device)
            finally:
                shared.leave_sync(self)

    def _set_up(self, device: RemoteDevice) -> None:
        """Identifies the transducer, loads its scale, switches TPDO 2 to 4 off, maps the first and starts it;
        the link is CONFIGURED.
        """
        device.identify(cia404.PROFILE)
        self._load_scale(device)
        for number in (2, 3, 4):
            device.offer(*pdo_off(True, number, self._settings.node_id))
        device.write_all(self._pdo.parameters())
        device.order(START)
        self.link.advance(LinkState.CONFIGURED)

    def _load_scale(self, device: RemoteDevice) -> None:
        """Reads the unit of the device, and sets `scale`, `calibration` and the conversion to newtons by it.
        DeviceSetupError: it is no unit of force. With `open_native` no calibration is loaded.
        """
        s, code = self._settings, int(device.read(cia404.UNIT))
        unit_n = cia404.newton_per_unit(code)
        if unit_n is None:
            raise DeviceSetupError(
                f"{device.name}: unit {code:08X} (6131); expected newtons ({cia404.NEWTON:08X}): set it with "
                "its maker's tool"
            )
        self.scale = CellScale(unit_n, s.full_scale_n)
        if s.calibration is not None and not self._native:
            about = s.driver, self.link.serial, date.today(), self.scale
            self.calibration = load_cell_calibration(s.calibration, *about)
        watch = StuckWatch(noisy=False)
        self._force = ForceScale(s.full_scale_n, s.sign, unit_n, self.calibration, watch, self.link.counters)

    def _exchange(self, conversation: Conversation, shared: SharedNetwork, device: RemoteDevice) -> Steps:
        """Subscribes to readings and emergencies, and runs the cycles until the conversation ends."""
        alarm = EMERGENCY + device.node
        self._tpdos, self._emergency = 0, 0
        shared.subscribe(self._pdo.can_id, self._on_reading)
        shared.subscribe(alarm, self._on_emergency)
        try:
            yield from self._cycles(conversation, shared)
        finally:
            shared.unsubscribe(self._pdo.can_id, self._on_reading)
            shared.unsubscribe(alarm, self._on_emergency)

    def _cycles(self, conversation: Conversation, shared: SharedNetwork) -> Steps:
        """Runs a cycle each period: sends SYNC where it is ours to send, counts periods without a TPDO. The
        link becomes READY at the first TPDO. DeviceError: silence, an emergency, or the bus failed.
        """
        period_s = 1.0 / self._settings.rate_hz
        patience = max(_SILENT_PERIODS, round(_SILENT_S / period_s))
        before, silent, pacer = 0, 0, Pacer(self._clock, round(period_s * 1e9))
        while not conversation.stopping:
            shared.check()
            if shared.sends_sync(self, _RANK):
                shared.send(SYNC, b"")
            silent = 0 if self._tpdos != before else silent + 1
            before = self._tpdos
            self.link.counters["silent_periods"] += bool(silent and before)
            shared.update_counters(self.link)
            self._judge(silent, patience)
            if before and self.link.state is LinkState.CONFIGURED:
                self.link.advance(LinkState.READY)
            yield pacer.wait_s()

    def _judge(self, silent: int, patience: int) -> None:
        if self._emergency:
            raise DeviceError(f"emergency {self._emergency:04X}")
        if silent > patience:
            raise DeviceError(f"no TPDO for {silent} periods")

    def _on_reading(self, can_id: int, data: bytearray, stamp: float) -> None:
        """Passes the measurement of a TPDO on, stamped now, to be checked and queued; only counts one of a
        wrong length. A value that is not finite becomes 0.
        """
        del can_id, stamp
        reading = cia404.measured(self._pdo, data)
        if reading is None:
            self.link.counters["bad_length"] += 1
            return
        self._tpdos += 1
        self.link.counters["tpdos"] += 1
        value = reading.value if isfinite(reading.value) else 0.0
        self._measured(Native(value, self._clock.now_ns(), reading.flaws))

    def _on_emergency(self, can_id: int, data: bytearray, stamp: float) -> None:
        del can_id, stamp
        self.link.counters["emergencies"] += 1
        self._emergency = emergency(data) or self._emergency  # one that is over within a period, too
