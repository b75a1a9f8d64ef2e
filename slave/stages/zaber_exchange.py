"""Exchanges with a Zaber stage that is configured: targets out, positions in. One thread."""

from collections import deque

from forefeel.common.clock import Clock
from forefeel.common.errors import DeviceError
from forefeel.common.hardware.conversation import Timed
from forefeel.common.hardware.link import DeviceLink
from forefeel.common.hardware.zaber import Reply, in_words, is_fault
from forefeel.slave.stages.port import StageReading
from forefeel.slave.stages.setpoint import Wanted
from forefeel.slave.stages.setpoint_mailbox import SetpointMailbox
from forefeel.slave.stages.settings import ZaberSettings
from forefeel.slave.stages.zaber_setup import ConfiguredStage, clear_faults, require_homed

_CARRIED_S = 0.020
_REST_NS = 2_000_000_000
_SMOOTHED = 0.1  # weight of the newest exchange in the usual time of one
_READINGS = 3  # a velocity is taken over: two exchanges
_GAP_NS = 100_000_000


class ZaberExchange:
    """The only place that makes a command that moves the stage; it asks the link every time.

    Attributes:
        reading: where the stage was last, with the host's stamp; replaced as a whole.
    """

    def __init__(
        self,
        device: ConfiguredStage,
        settings: ZaberSettings,
        clock: Clock,
        link: DeviceLink,
        orders: SetpointMailbox,
    ) -> None:
        self._talk, self._scale, self._limits = device.talk, device.scale, device.limits
        self._settings, self._clock, self._link, self._orders = settings, clock, link, orders
        self._positions: deque[tuple[int, float]] = deque(maxlen=_READINGS)
        self._usual_s = 0.0
        self._last_ns: int | None = None
        self._since_ns = 0
        self.reading = Timed(0, None, StageReading(0.0, 0.0))

    def begin(self) -> None:
        """The start, and the start anew after an explicit re-arming: old faults are acknowledged.

        Raises:
            DeviceSetupError: one stays, or the stage is not homed.
        """
        self._last_ns = None
        clear_faults(self._talk, self._link)
        require_homed(self._talk, self._link)
        self.watch()

    def watch(self) -> None:
        """Only where it is."""
        asked_ns = self._clock.now_ns()
        x_m = self._scale.metres(self._talk.number("get pos"))
        self._took((asked_ns + self._clock.now_ns()) // 2, x_m)

    def step(self) -> None:
        """What is due, with a position in the same exchange.

        Raises:
            DeviceError: a rejected command, a warning flag that forbids motion, silence, the port is gone.
        """
        began_ns = self._clock.now_ns()
        stop_due, setpoint = self._due(began_ns)
        order = ["stop"] if stop_due else [] if setpoint is None else [self._move(setpoint, began_ns)]
        texts = [*order, "get pos"]
        replies = self._talk.exchange(texts)
        for text, reply in zip(texts, replies, strict=True):
            if reply is not None:
                self._check(text, reply.value)
        if stop_due and replies[0] is not None:
            self._orders.stopped()
        where = replies[-1]
        if where is not None:
            self._took(where.host_ns, self._metres(where.value))
        took_s = (self._clock.now_ns() - began_ns) * 1e-9
        if where is not None:
            self._link.exchanged(round(took_s * 1e9))
        self._usual_s += (took_s - self._usual_s) * _SMOOTHED

    def _due(self, now_ns: int) -> tuple[bool, Wanted | None]:
        """What is ordered now. When this thread stood still for longer than the lead, so did the stage: what
        was wanted before is over.
        """
        if self._last_ns is not None and now_ns - self._last_ns > self._settings.lead_s * 1e9:
            self._link.counters["stood_still"] += 1
            self._orders.hold()
            self._since_ns = now_ns
        self._last_ns = now_ns
        stop_due, setpoint = self._orders.now()
        over = setpoint is not None and setpoint.stamp_ns < self._since_ns
        return stop_due, None if over else setpoint

    def try_stop(self) -> None:
        """After a fault: a stop, whether or not anybody hears it."""
        try:
            self._talk.post(["stop"])
        except DeviceError:
            self._link.counters["stops_not_sent"] += 1  # the bounded target stops it

    def rest(self) -> None:
        """The orderly end: stops, and waits until the stage is at rest.

        Raises:
            DeviceError: it does not answer, or does not come to rest.
        """
        self._talk.ask("stop")
        until_ns = self._clock.now_ns() + _REST_NS
        while self._clock.now_ns() < until_ns:
            (reply,) = self._talk.exchange([""])
            if reply is not None and not reply.value.busy:
                return
        raise DeviceError(f"{self._link.name}: still busy {_REST_NS * 1e-9:g} s after a stop")

    def _move(self, setpoint: Wanted, now_ns: int) -> str:
        self._link.require_ready()
        return f"move abs {self.target(setpoint, now_ns)}"

    def target(self, setpoint: Wanted, now_ns: int) -> int:
        """Where the stage is sent, in microsteps: never further than `lead_s` ahead of the setpoint nor of
        where the stage is, and within travel and limits.

        It is carried on by the time that the device needs to get it and by the distance that it brakes over,
        v / 2A, so that a steady motion is not braked at each target.
        """
        settings, (position_m, velocity_m_s, stamp_ns) = self._settings, setpoint
        braking_s = 0.5 * abs(velocity_m_s) / settings.max_acceleration_m_s2
        ahead_s = max(0, now_ns - stamp_ns) * 1e-9 + self._usual_s + braking_s
        low_m, high_m = settings.travel_m
        target_m = position_m + velocity_m_s * min(ahead_s, settings.lead_s)
        target_m = max(low_m, min(high_m, target_m))
        reach_m = settings.max_velocity_m_s * settings.lead_s
        here_m = self._here_m(now_ns)
        target_m = max(here_m - reach_m, min(here_m + reach_m, target_m))
        lowest, highest = self._limits
        return max(lowest, min(highest, self._scale.native(target_m)))

    def _here_m(self, now_ns: int) -> float:
        stamp_ns, _, (position_m, velocity_m_s) = self.reading
        return position_m + velocity_m_s * min(max(now_ns - stamp_ns, 0) * 1e-9, _CARRIED_S)

    def _check(self, text: str, reply: Reply) -> None:
        flag = self._talk.accepted(text, reply).warning
        if is_fault(flag):
            raise DeviceError(f"{self._link.name}: {in_words(flag)}")
        if flag.startswith("W"):
            self._link.counters[f"warning_{flag}"] += 1

    def _metres(self, reply: Reply) -> float:
        return self._scale.metres(self._talk.as_number("get pos", reply.data))

    def _took(self, stamp_ns: int, position_m: float) -> None:
        """A position, and the velocity over the last ones."""
        if self._positions and stamp_ns - self._positions[-1][0] > _GAP_NS:
            self._positions.clear()
        self._positions.append((stamp_ns, position_m))
        first_ns, first_m = self._positions[0]
        elapsed_s = (stamp_ns - first_ns) * 1e-9
        velocity_m_s = (position_m - first_m) / elapsed_s if elapsed_s > 0 else 0.0
        self.reading = Timed(stamp_ns, None, StageReading(position_m, velocity_m_s))
