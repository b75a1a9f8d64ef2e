"""Bilateral controllers of the literature, for `python -m benchmarks.felt_force`: one process, virtual time.

Operator, world with its noise, stage, limiter and delay are those of the other rows. In place of both daemons
stands a controller at 1 kHz. It exchanges velocities and forces; the slave integrates its own position. The
force f resists insertion, the hand moves with v.

- `TwoPort`: time-domain passivity of a two-port (Ryu, Artigas, Preusche, Mechatronics 20(7), 2010; Artigas,
  Ryu, Preusche, Hirzinger, IROS 2011). What leaves the channel at one end must have entered it at the other:
  E_out(n) <= E_in(n - delay). The slave's controller reduces the velocity, the master's the force. Tuned: a
  damping b of the hand, which pays for the first touch; and how fast the slave catches up what it lags behind
  where the energy permits (Chawda, Van Quang, O'Malley, Ryu, IEEE Haptics Symposium 2014).
- `Waves`: wave variables (Niemeyer, Slotine, IEEE J. Oceanic Engineering 16(1), 1991): to the slave goes
  u = (b v + f) / sqrt(2 b), back goes w = (b v - f) / sqrt(2 b), each through a low pass: without it waves
  grow, for stage and limiter lie inside the port. Tuned: the impedance b, the low pass, and how fast the
  slave is drawn to the position of the hand (Chopra, Spong, Hirche, Buss, ACC 2003).

`PEERS` has the grids; b ends where free motion at 50 mm/s takes all that the handle has. Shown is the tuning
with the smallest error of the felt force at that very wall, among those that give the hand no more than 1 mJ;
a user could not know it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import exp, pi, sqrt
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.motion import Lag
from forefeel.common.limiter import MotionLimiter
from forefeel.common.messages import MotionCommand, SafetyState
from forefeel.master.handle import Handle, HandleReading, Indication
from forefeel.report.transparency import Twin
from forefeel.slave.plant.world import SimulatedWorld
from forefeel.slave.settings import SlaveAxisSettings

Floats = NDArray[np.float64]
_TICK_NS = 1_000_000
_TICK_S = 1e-3
_ENGAGING_S = 0.5  # from the press to the light that lets the hand move, about as in the other rows
_LEAST_N = 1e-3  # a force that is no port's: half of the load cell's noise
_MOST_DAMPING_N_S_M = 40.0  # of a force against the hand: far below m / T of 0.15 kg


class Down(NamedTuple):
    """From the master: velocity (or wave), the position of the hand, energy that entered at its end."""

    flow: float
    position_m: float
    energy_j: float
    deadman: bool


class Up(NamedTuple):
    """From the slave: force (or wave), the force as it was measured, energy that entered at its end."""

    flow: float
    force_n: float
    energy_j: float


class Controller(Protocol):
    def slave(self, sent: Down, force_n: float, position_m: float) -> tuple[float, Up]:
        """The velocity of the setpoint, which is at `position_m`, and the answer."""
        ...

    def master(self, reading: HandleReading, answer: Up) -> tuple[float, Down]:
        """The force to render, and what to send."""
        ...


class Port:
    """Energy in J that has entered and left the channel at one end."""

    def __init__(self) -> None:
        self.entered_j = 0.0
        self.left_j = 0.0

    def add(self, entering_j: float) -> None:
        self.entered_j += max(entering_j, 0.0)
        self.left_j += max(-entering_j, 0.0)


class TwoPort:
    def __init__(self, most_n: float, damping_n_s_m: float, catching_up_1_s: float) -> None:
        self._most_n, self._b, self._catching_up_1_s = most_n, damping_n_s_m, catching_up_1_s
        self._hand, self._contact = Port(), Port()
        self._rendered_n = 0.0
        self._hand_m: float | None = None

    def slave(self, sent: Down, force_n: float, position_m: float) -> tuple[float, Up]:
        velocity_m_s = sent.flow + self._catching_up_1_s * (sent.position_m - position_m)
        left_j = sent.energy_j - self._contact.left_j
        if abs(force_n) > _LEAST_N and force_n * velocity_m_s * _TICK_S > left_j:
            velocity_m_s = left_j / (force_n * _TICK_S)
        self._contact.add(-force_n * velocity_m_s * _TICK_S)
        return velocity_m_s, Up(force_n, force_n, self._contact.entered_j)

    def master(self, reading: HandleReading, answer: Up) -> tuple[float, Down]:
        velocity_m_s = reading.velocity_m_s
        moved_m = 0.0 if self._hand_m is None else reading.position_m - self._hand_m
        self._hand_m = reading.position_m
        self._hand.add(self._rendered_n * moved_m)
        force_n, left_j = answer.flow, answer.energy_j - self._hand.left_j
        if -force_n * velocity_m_s * _TICK_S > left_j:
            force_n = -left_j / (velocity_m_s * _TICK_S)
            damped_n = _MOST_DAMPING_N_S_M * abs(velocity_m_s)
            if force_n * velocity_m_s > 0.0:
                force_n = max(-damped_n, min(damped_n, force_n))
        force_n += self._b * velocity_m_s
        self._rendered_n = max(-self._most_n, min(self._most_n, force_n))
        return self._rendered_n, Down(velocity_m_s, reading.position_m, self._hand.entered_j, reading.deadman)


class Waves:
    def __init__(self, most_n: float, impedance_n_s_m: float, filter_hz: float, drawn_1_s: float) -> None:
        self._most_n, self._b, self._drawn_1_s = most_n, impedance_n_s_m, drawn_1_s
        self._to_slave, self._to_master = Lag(), Lag()
        self._decay = exp(-2.0 * pi * filter_hz * _TICK_S)

    def slave(self, sent: Down, force_n: float, position_m: float) -> tuple[float, Up]:
        share = sqrt(2.0 / self._b)
        wave = self._to_slave.step(sent.flow, self._decay)
        velocity_m_s = share * wave - force_n / self._b
        velocity_m_s += self._drawn_1_s * (sent.position_m - position_m)
        return velocity_m_s, Up(wave - share * force_n, force_n, 0.0)

    def master(self, reading: HandleReading, answer: Up) -> tuple[float, Down]:
        damped_n, root = self._b * reading.velocity_m_s, sqrt(2.0 * self._b)
        wave = self._to_master.step(answer.flow, self._decay)
        force_n = max(-self._most_n, min(self._most_n, damped_n - root * wave))
        return force_n, Down((damped_n + force_n) / root, reading.position_m, 0.0, reading.deadman)


Make = Callable[[float], Controller]
"""A controller for a handle that applies so many N at most."""


@dataclass(frozen=True, slots=True)
class Peer:
    """A controller, and its tunings by their names."""

    name: str
    tunings: dict[str, Make]


def _two_port(damping_n_s_m: float, catching_up_1_s: float) -> Make:
    return lambda most_n: TwoPort(most_n, damping_n_s_m, catching_up_1_s)


def _waves(impedance_n_s_m: float, filter_hz: float, drawn_1_s: float) -> Make:
    return lambda most_n: Waves(most_n, impedance_n_s_m, filter_hz, drawn_1_s)


PEERS = (
    Peer(
        "two-port passivity",
        {
            f"b {damping:g} N s/m, catching up {rate:g}/s": _two_port(damping, rate)
            for damping, rate in product((0.0, 10.0, 20.0, 40.0, 80.0), (0.0, 5.0))
        },
    ),
    Peer(
        "wave variables",
        {
            f"b {impedance:g} N s/m, {filter_hz:g} Hz, drawn {rate:g}/s": _waves(impedance, filter_hz, rate)
            for impedance, filter_hz, rate in product((5.0, 10.0, 20.0, 40.0, 80.0), (5.0, 20.0), (0.0, 1.0))
        },
    ),
)


@dataclass(frozen=True, slots=True)
class Trace:
    """Of the ticks in which the slave followed: time in s; felt, held and true force in N; and in m how far
    the stage is from where the command that it executes wants it.
    """

    time_s: Floats
    felt_n: Floats
    held_n: Floats
    true_n: Floats
    behind_m: Floats


def simulate(
    controller: Controller, handle: Handle, settings: SlaveAxisSettings, delay_s: float, duration_s: float
) -> Trace:
    """One run with `delay_s` each way; the twin, whose force is true, gets the motion of the hand at once."""
    ticks, delay = round(duration_s / _TICK_S), round(delay_s / _TICK_S)
    start_ns = 1_000 * _TICK_NS
    world = SimulatedWorld(settings.simulation, settings.seed)
    twin = Twin(settings, start_ns, delay * _TICK_NS)
    limiter = MotionLimiter(settings.limits, settings.gate.stop_deceleration_m_s2)
    limiter.place(settings.simulation.stage.start_m)
    world.advance(start_ns)
    down, up, rows = list[Down](), list[Up](), list[tuple[float, ...]]()
    pressed = 0
    for n in range(ticks):
        now_ns = start_ns + n * _TICK_NS
        force_n, stage_m = world.load_cell_reading().force_n, world.stage_readback()[0]
        sent = down[n - delay] if n >= delay else Down(0.0, stage_m, 0.0, False)
        answer = Up(0.0, 0.0, 0.0)
        if sent.deadman:
            velocity_m_s, answer = controller.slave(sent, force_n, limiter.position_m)
            limiter.follow(limiter.position_m + velocity_m_s * _TICK_S, velocity_m_s, force_n, _TICK_S)
        up.append(answer)
        world.set_target(limiter.position_m, limiter.velocity_m_s, now_ns)
        world.advance(now_ns + _TICK_NS)
        armed = pressed * _TICK_S > _ENGAGING_S
        handle.show(Indication(SafetyState.ARMED if armed else SafetyState.READY, stage_m))
        reading = handle.read(now_ns)
        pressed = pressed + 1 if reading.deadman else 0
        arrived = up[n - delay] if n >= delay else Up(0.0, 0.0, 0.0)
        felt_n, command = controller.master(reading, arrived)
        felt_n = felt_n if reading.deadman else 0.0
        handle.render(felt_n, now_ns)
        down.append(command)
        asked = MotionCommand(
            session_id=1, sequence=n, stamp_ns=now_ns, position_m=reading.position_m,
            velocity_m_s=reading.velocity_m_s, deadman=reading.deadman,
        )  # fmt: skip
        true_n = twin.force_n(asked)
        if armed:
            rows.append((n * _TICK_S, felt_n, arrived.force_n, true_n, stage_m - sent.position_m))
    return Trace(*np.array(rows).T)
