"""Does the force limit hold, and how fast is the way there: `python -m benchmarks.force_limit`, virtual time.

First table: the slave's limits, stage and load cell at a wall without friction 30 mm from the start, that is
met at 20, 80 and 190 mm/s. Overshoot of the limit of 3 N in %, of the force without noise; `stop`: the ramp
to rest begins as soon as the wall is felt. The bound `stiffest_wall_n_m` is 3000 N/m.

Second table: both daemons across a round trip, strokes of 60 mm with a wall of 1000 N/m 40 mm from their
start. Fastest speed of the stage in the open, while nothing is known of the wall (first stroke) and later;
overshoot of the limit in the whole run; share of the time in which force or band slowed the setpoint.
"""

import numpy as np

from benchmarks.felt_force import SEED, Row
from forefeel.common.limiter import MotionLimiter
from forefeel.common.settings import AxisLimits
from forefeel.common.topics import FORCE, LIMIT_EVENT
from forefeel.slave.plant.world import SimulatedWorld
from tests.simulation.pair import Pair, S

LIMITS = AxisLimits()
WALLS_N_M = (200.0, 1000.0, 3000.0, 4500.0, 6000.0)
SPEEDS_M_S = (0.02, 0.08, 0.19)
FELT_N = 0.02
ROUND_TRIPS_S = (0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6)
CONTACT_M = 0.045
FAST = {"depth_m": 0.06, "insert_s": 0.6, "withdraw_s": 0.6}
SLOWED_BY = ("contact_speed", "force")
DURATION_S, KNOWN_S = 16.0, 8.0


def overshoot(stiffness_n_m: float, speed_m_s: float, stops: bool = False) -> float:
    """Of the limit in %, at a wall that is met with that speed where the limits allow it."""
    settings = Row("wall", stiffness_n_m, 0.3).plan().slave_settings().axes[0]
    plant = SimulatedWorld(settings.simulation, SEED)
    limiter = MotionLimiter(LIMITS, settings.gate.stop_deceleration_m_s2)
    force_n = most_n = command_m = 0.0
    for tick in range(3000):
        moves = command_m < 0.04
        command_m += speed_m_s * 1e-3 if moves else 0.0
        if stops and force_n > FELT_N:
            limiter.stop(1e-3, force_n)
        else:
            limiter.follow(command_m, speed_m_s if moves else 0.0, force_n, 1e-3)
        plant.set_target(limiter.position_m, limiter.velocity_m_s, tick * S // 1000)
        plant.advance((tick + 1) * S // 1000)
        force_n = plant.load_cell_reading().force_n
        most_n = max(most_n, force_n)
    return 100.0 * (most_n / LIMITS.max_force_n - 1.0)


def across(round_trip_s: float) -> str:
    """A row of the second table."""
    plan = Row("wall", 1000.0, round_trip_s, hand=FAST).plan()
    axis = plan.slave["axes"][0]
    axis["limits"] = plan.master["axes"][0]["limits"] = {}
    axis["simulation"]["contact"]["effects"][0]["parameters"]["contact_position_m"] = CONTACT_M
    pair = Pair(plan.slave, plan.master)
    pair.to_slave.delay_s = pair.to_master.delay_s = round_trip_s / 2
    pair.run(DURATION_S)
    time_s, position_m, velocity_m_s, force_n = (
        pair.heard.column(FORCE, name) for name in ("stamp_ns", "position_m", "velocity_m_s", "force_n")
    )
    later = time_s / S > KNOWN_S
    first = np.maximum.accumulate(position_m) < CONTACT_M
    slowed = sum(m.count for m in pair.heard.messages(LIMIT_EVENT) if m.rule in ("contact_speed", "force"))
    fastest = [1e3 * velocity_m_s[part & (position_m < CONTACT_M)].max() for part in (first, later)]
    most = 100.0 * (np.abs(force_n).max() / LIMITS.max_force_n - 1.0)
    return f"{round_trip_s * 1e3:6.0f}{fastest[0]:12.1f}{fastest[1]:10.1f}{most:12.2f}{slowed:10.1f}"


def main() -> None:
    print("overshoot in %:   " + "".join(f"{1e3 * v:8.0f} mm/s" for v in SPEEDS_M_S) + "     stop")
    for stiffness_n_m in WALLS_N_M:
        met = [overshoot(stiffness_n_m, speed_m_s) for speed_m_s in SPEEDS_M_S]
        met.append(overshoot(stiffness_n_m, SPEEDS_M_S[-1], stops=True))
        print(f"{stiffness_n_m:6.0f} N/m       " + "".join(f"{each:13.1f}" for each in met), flush=True)
    print("ms    fastest, mm/s: first     later   overshoot %   slowed %")
    for round_trip_s in ROUND_TRIPS_S:
        print(across(round_trip_s), flush=True)


if __name__ == "__main__":
    main()
