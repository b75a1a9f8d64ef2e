"""What is required of the service at a fault, each number with its reason."""

from dataclasses import dataclass
from typing import Any

from forefeel.common.topics import COMMAND, FORCE, SLAVE_STATE
from forefeel.devices.zaber.settings import ZaberSettings
from forefeel.slave.settings import GateSettings
from tests.system.net.service import FASTEST_M_S, HARDEST_M_S2, LEAD_S

MARGIN_S = 0.050
"""Two shared cores: a process of this test may wait that long for its turn."""

_GATE = GateSettings()
WATCHDOG_S = COMMAND.stale_after_s or 0.060
RAMP_S = 0.2 / _GATE.stop_deceleration_m_s2
"""max_velocity_m_s / stop_deceleration_m_s2 of deploy/config: from full speed to rest."""
SERVO_S = 0.040
"""The simulated drive, 12 Hz and critically damped or better, follows its setpoint to 10 um by then."""
FORCE_STALE_S = FORCE.stale_after_s or 0.1
"""stale_s of the rendering: a force that is older than that above the usual is not shown as fresh."""
FADE_S = 0.2
"""fade_s of the rendering."""
_TOLD_S = 1.0 / (SLAVE_STATE.rate_hz or 50.0)
"""The slave tells its state once in this time."""

BY_SILENCE_S = WATCHDOG_S + RAMP_S + SERVO_S + MARGIN_S
"""From one instant on no command arrives, not even one that is under way: the watchdog, the ramp, the drive.
A delay changes nothing.
"""
BY_FAULT_S = RAMP_S + SERVO_S + MARGIN_S
"""The slave notices by itself, at its next tick."""
COMMANDED_S = 2.0
"""`forefeel estop` has started and reached the slave by then; rest is timed from its arrival on."""
BY_DRIVE_S = LEAD_S + FASTEST_M_S / HARDEST_M_S2 + MARGIN_S
"""The slave is gone: the drive runs to the end of the last setpoint's lead, and brakes."""
BY_DEVICE_S = LEAD_S + FASTEST_M_S / HARDEST_M_S2 + RAMP_S + MARGIN_S
"""A device does not answer any more: its driver waits for as long as the lead, then the slave ramps down."""
STRAYED_S = 4 * ZaberSettings.model_fields["lag_s"].default + BY_FAULT_S
"""A stage at a fraction of its speed is off by more than the lag explains soon after it, unless it turns."""
PULLED_S = 2.5
"""A stroke out and the next one in, to where the force is 5 % of the limit."""
BLIND_S = (_GATE.force_timeout_s or 0.0) + RAMP_S + SERVO_S + MARGIN_S
"""Invalid readings are borne for force_timeout_s."""
STUCK_S = 1.0 + BLIND_S
"""A cell that repeats itself is believed for a second: it may be at rest."""
RECORDER_FLUSH_S = 1.4
"""What a killed recorder loses: ten waits of 0.1 s since its last flush, the writing, the queue."""

FADED_S = FORCE_STALE_S + FADE_S + MARGIN_S
"""From one instant on no force arrives, or the master was frozen and wakes up: stale_s and fade_s."""
STALE_FELT_S = FADE_S + MARGIN_S
"""Once no force is fresh any more, what is felt fades in fade_s."""
FORCE_AGE_S = FORCE_STALE_S + 0.010
"""A force is fresh up to FORCE_STALE_S above the usual; the comparison of the clocks wanders by some ms."""

RATE_NAMED_S = 8.0
"""The slave names a rate that 3 s of transits show, or 6 s where they jitter, and looks once a second.
Until then ages stay right, for they are measured within a second.
"""

STALE_S = _GATE.max_age_s + 0.005
"""max_age_s above the usual age; a force tells the tick in which its command began to within some ms."""
STILL_M = 20e-6
"""Noise of a stage at rest."""

DISK_FULL_S = 2.0
"""What a recorder loses whose disk becomes full: the second that was being written, and the one after it."""

FLOWN = 20
"""Ticks in a flight record, at least: its daemon may have begun just before. One that stood still for longer
than a record reaches back has those since."""


@dataclass(frozen=True, slots=True)
class Route:
    """The usual cable of a case, and the limits that depend on its delay.

    Attributes:
        there_s: mean delay of a packet to the slave.
        back_s: the same to the master.
        jitter_s: half-width of their variation.
    """

    there_s: float = 0.010
    back_s: float = 0.010
    jitter_s: float = 0.002

    @property
    def ways(self) -> dict[str, dict[str, Any]]:
        """What the cable is told, by direction: the slave is on its first host."""
        delays = {"ba": self.there_s, "ab": self.back_s}
        return {way: {"delay_s": delay_s, "jitter_s": self.jitter_s} for way, delay_s in delays.items()}

    @property
    def by_watchdog_s(self) -> float:
        """The master sends no command any more: what is under way arrives first."""
        return self.there_s + self.jitter_s + BY_SILENCE_S

    @property
    def faded_s(self) -> float:
        """The slave sends no force any more: what is under way arrives first."""
        return self.back_s + self.jitter_s + FADED_S

    @property
    def told_s(self) -> float:
        """The master's commands are not followed any more while forces still come: they arrive, the watchdog
        runs out, the slave's next state tells it, and the force fades.
        """
        there_and_back_s = self.there_s + self.back_s + 2.0 * self.jitter_s
        return there_and_back_s + WATCHDOG_S + _TOLD_S + FADE_S + MARGIN_S


NEAR = Route()
FAR = Route(0.150, 0.150)
SLOW = Route(0.250, 0.250)
"""Of the jump: its round trip is below max_round_trip_s."""
ASYMMETRIC = Route(0.200, 0.010)
