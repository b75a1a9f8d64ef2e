"""What is required of the service at a fault, each number with its reason."""

from typing import Any

from common.topics import COMMAND, FORCE
from slave.settings import GateSettings
from tests.net.service import FASTEST_M_S, HARDEST_M_S2, LEAD_S

ONE_WAY_S, JITTER_S = 0.010, 0.002
"""Of the cable in every case."""
WAY: dict[str, Any] = {"delay_s": ONE_WAY_S, "jitter_s": JITTER_S}
MARGIN_S = 0.050
"""Two shared cores: a process of this test may wait that long for its turn."""

_GATE = GateSettings()
WATCHDOG_S = COMMAND.stale_after_s or 0.060
RAMP_S = 0.2 / _GATE.stop_deceleration_m_s2
"""max_velocity_m_s / stop_deceleration_m_s2 of deploy/config: from full speed to rest."""
SERVO_S = 0.040
"""The simulated drive, 12 Hz and critically damped or better, follows its setpoint to 10 um by then."""

BY_WATCHDOG_S = ONE_WAY_S + JITTER_S + WATCHDOG_S + RAMP_S + SERVO_S + MARGIN_S
"""The commands no longer come: what is under way arrives, the watchdog runs out, the ramp, the drive."""
BY_FAULT_S = RAMP_S + SERVO_S + MARGIN_S
"""The slave notices by itself, at its next tick."""
BY_DRIVE_S = LEAD_S + FASTEST_M_S / HARDEST_M_S2 + MARGIN_S
"""The slave is gone: the drive runs to the end of the last setpoint's lead, and brakes."""
BY_SILENCE_S = LEAD_S + FASTEST_M_S / HARDEST_M_S2 + RAMP_S + MARGIN_S
"""A device does not answer any more: its driver waits for as long as the lead, then the slave ramps down."""
BLIND_S = (_GATE.force_timeout_s or 0.0) + RAMP_S + SERVO_S + MARGIN_S
"""Invalid readings are borne for force_timeout_s."""
STUCK_S = 1.0 + BLIND_S
"""A cell that repeats itself is believed for a second: it may be at rest."""
NOTICED_S = 1.0 + MARGIN_S
"""The audit log looks once a second whether there is room."""
RECORDER_FLUSH_S = 1.4
"""What a killed recorder loses: ten waits of 0.1 s since its last flush, the writing, the queue."""

FADED_S = (FORCE.stale_after_s or 0.1) + 0.2 + ONE_WAY_S + JITTER_S + MARGIN_S
"""stale_s + fade_s of the rendering after the last force that arrived."""

STALE_S = _GATE.max_age_s + 0.005
"""max_age_s above the usual age; a force tells the tick in which its command began to within some ms."""
STILL_M = 20e-6
"""Noise of a stage at rest."""
ENDS_AFTER_S = 0.030
"""A slave that ends by itself waits for 50 ms once the stage is at rest; some readings may be missing."""

FLOWN = 100
"""Ticks in a flight record of 2 s, at least: its daemon may have begun, or stood still, meanwhile."""
FLOWN_BEFORE_NS = 100_000_000
"""What is executed at the beginning of a flight record may have come before it."""
GAP_NS = 5e6
"""Between the cycles around a force; in longer gaps the loop stood still."""
SET_BACK_NS = 500_000_000
READBACK_M = 0.5e-3
"""The position of a force is that between the cycles around it, but for rounding; where the stage fails
within a cycle, off by what it moves in some ms."""
