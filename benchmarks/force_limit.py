"""Does the force limit hold, and how fast is the way there: `python -m benchmarks.force_limit`, virtual time.

First table: the slave's limits, stage and load cell at a wall without friction 30 mm from the start, that is
met at 20, 80 and 190 mm/s. Overshoot of the limit of 3 N in %, of the force without noise; `stop`: the ramp
to rest begins as soon as the wall is felt. The bound `stiffest_wall_n_m` is 3000 N/m.

Second table: both daemons at 300 ms, strokes of 60 mm in .8 s, a wall 3 mm from their start and the load
cells, stages, loops and walls of `CASES`, `stiffest_wall_n_m` set to the wall where not said otherwise. Speed
that the limit leaves as the arming says it, and what share of it is reached in the open; largest true force
at the limit of 3 N; time from an excess of 5 % to its event; why it ends or does not arm. Argument: the seed.

Third table: both daemons across a round trip, strokes of 60 mm with a wall of 1000 N/m 40 mm from their
start. Fastest speed of the stage in the open, while nothing is known of the wall (first stroke) and later;
overshoot of the limit in the whole run; share of the time in which force or band slowed the setpoint.
"""

import sys
from collections import deque
from collections.abc import Callable
from math import inf, pi, sin
from typing import Any

import numpy as np

from benchmarks.felt_force import CONTACT_M as NEAR_M
from benchmarks.felt_force import SEED, Row
from forefeel.common.limiter import MotionLimiter, Reaction, open_speed_m_s
from forefeel.common.settings import AxisLimits
from forefeel.common.topics import FORCE, LIMIT_EVENT, SLAVE_STATE
from forefeel.slave.load_cell import LoadCell, LoadCellReading
from forefeel.slave.plant.world import SimulatedWorld
from tests.simulation.pair import Pair, S

LIMITS = AxisLimits()
WALLS_N_M = (200.0, 1000.0, 3000.0, 4500.0, 6000.0)
SPEEDS_M_S = (0.02, 0.08, 0.19)
FELT_N = 0.02
ROUND_TRIPS_S = (0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6)
CONTACT_M = 0.045
STROKES = {"depth_m": 0.06, "insert_s": 0.8, "withdraw_s": 0.8}
FAST = {"depth_m": 0.06, "insert_s": 0.6, "withdraw_s": 0.6}
DURATION_S, KNOWN_S = 16.0, 8.0


MS = 1_000_000
SOFT_M, STIFF_N_M = 0.005, 6000.0
CASES: dict[str, dict[str, Any]] = {
    "as it is": {},
    "cell 20 ms late": {"late_ms": 20},
    "cell 50 ms late": {"late_ms": 50},
    "cell 150 ms late": {"late_ms": 150},
    "cell of 20 Hz": {"every_ms": 50},
    "cell of 10 Hz": {"every_ms": 100},
    "filter of 5 Hz": {"cell": {"filter_hz": 5.0}},
    "filter of 2 Hz": {"cell": {"filter_hz": 2.0}},
    "20 ms that no stamp shows, in filter_lag_s": {"hidden_s": 0.02},
    "stage of 8 Hz": {"stage": {"bandwidth_hz": 8.0}},
    "stage of 3 Hz": {"stage": {"bandwidth_hz": 3.0}},
    "loop of 10 ms": {"tick_ms": 10},
    "loop of 10 ms after 5 s": {"tick_ms": 10, "late_from_s": 5.0},
    "10,000 N/m": {"wall_n_m": 10_000.0},
    "100, then 6000 N/m": {"wall_n_m": 100.0, "stiffest_n_m": STIFF_N_M, "more": "stiff"},
    "10,000 N/m, setting 3000": {"wall_n_m": 10_000.0, "stiffest_n_m": 3000.0},
    "cell of the wrong sign": {"sign": -1},
    "zero off by -1.5 N": {"cell": {"bias_n": -1.5}},
    "1500 N/m, moves 3 mm at 1.2 Hz": {"wall_n_m": 1500.0, "more": "moves"},
}


class LateCell:
    """Takes the place of a load cell's `read`: some readings, later, stamped when they were made."""

    def __init__(self, cell: LoadCell, late_ms: int, every_ms: int, sign: int) -> None:
        self._sign, self._late_ms, self._every_ms = sign, late_ms, every_ms
        self._made = deque[tuple[int, LoadCellReading]]()
        self._read = cell.read
        vars(cell)["read"] = self.read

    def read(self, now_ns: int, recording_time_s: float | None) -> list[LoadCellReading]:
        readings = self._read(now_ns, recording_time_s)
        if now_ns // MS % self._every_ms == 0:
            self._made += [
                (now_ns, each._replace(force_n=self._sign * each.force_n, stamp_ns=now_ns))
                for each in readings
            ]
        due_ns = now_ns - self._late_ms * MS
        arrived = [reading for made_ns, reading in self._made if made_ns <= due_ns]
        for _ in arrived:
            self._made.popleft()
        return arrived


class Case:
    """Both daemons in a row's world. `more`: what the wall does that no effect has.

    Attributes:
        most_n: the largest true force so far. fastest_m_s: of the stage in the open.
    """

    def __init__(  # noqa: PLR0913, PLR0917 - the columns of CASES
        self,
        cell: dict[str, float] | None = None,
        stage: dict[str, float] | None = None,
        wall_n_m: float = 3000.0,
        stiffest_n_m: float | None = None,
        late_ms: int = 0,
        every_ms: int = 1,
        sign: int = 1,
        hidden_s: float = 0.0,
        more: str = "",
        tick_ms: int = 1,
        late_from_s: float = 0.0,
        seed: int = SEED,
    ) -> None:
        plan = Row("wall", wall_n_m, 0.3, hand=STROKES).plan(seed)
        axis = plan.slave["axes"][0]
        axis["limits"] = plan.master["axes"][0]["limits"] = {"stiffest_wall_n_m": stiffest_n_m or wall_n_m}
        world = axis["simulation"]
        world |= {"load_cell": {"full_scale_n": 50.0, **(cell or {})}, "stage": stage or {}}
        if hidden_s:
            world["contact"]["effects"].append({"effect": "time_delay", "parameters": {"delay_s": hidden_s}})
            axis["load_cell"] = {"driver": "simulated", "filter_lag_s": hidden_s}
        self.pair = Pair(plan.slave, plan.master)
        self.pair.to_slave.delay_s = self.pair.to_master.delay_s = 0.15
        self.most_n = self.fastest_m_s = 0.0
        self._more, self._exceeded_s = more, inf
        self._late = LateCell(self.pair.slave.axes[0]._devices.load_cell, late_ms, every_ms, sign)
        fixture = vars(self.pair.slave.axes[0]._devices.stage)["_world"]._fixture
        self._force_n: Callable[[float, float, float, float, float], float] = fixture.step
        fixture.step = self._step
        self._tick, self._tick_ms, self._late_from_s = self.pair.slave.axes[0].tick, tick_ms, late_from_s
        vars(self.pair.slave.axes[0])["tick"] = self._seldom

    def _step(self, t: float, x: float, v: float, a: float, dt: float) -> float:
        self.fastest_m_s = max(self.fastest_m_s, v) if x < NEAR_M else self.fastest_m_s
        if self._more == "moves":
            x -= 0.0015 * sin(2.0 * pi * 1.2 * t)
        force_n = self._force_n(t, x, v, a, dt)
        if self._more == "stiff":
            force_n += STIFF_N_M * max(0.0, x - NEAR_M - SOFT_M)
        if force_n > 1.05 * LIMITS.max_force_n and self._exceeded_s == inf:
            self._exceeded_s = self.pair.runtime.clock.now_ns() / S
        self.most_n = max(self.most_n, force_n)
        return force_n

    def _seldom(self, now_ns: int) -> None:
        if self.pair.runtime.clock.now_ns() / S < self._late_from_s or now_ns // MS % self._tick_ms == 0:
            self._tick(now_ns)

    @property
    def said_s(self) -> float:
        """From the first excess of 5 % to the first event about it."""
        events = [m.stamp_ns / S for m in self.pair.traffic.messages(LIMIT_EVENT) if m.rule == "over_limit"]
        return min(events, default=inf) - self._exceeded_s

    def row(self) -> str:
        reactions = [m.reaction_s for m in self.pair.traffic.messages(SLAVE_STATE) if m.reaction_s]
        limits = self.pair.slave.axes[0].settings.limits
        speed_m_s = open_speed_m_s(limits, Reaction(*reactions[-1]))
        events = [event for _, event in self.pair.traffic.events() if event in ("fault", "watchdog")]
        armed = bool(self.pair.traffic.times("engage"))
        return (
            f"{1e3 * speed_m_s:9.1f}{self.fastest_m_s / speed_m_s:9.2f}"
            f"{self.most_n:9.3f}{1e3 * self.said_s:9.0f}"
            f"  {', '.join(events) if armed else self.pair.slave.axes[0].reason}"
        )


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
    """A row of the third table."""
    plan = Row("wall", 1000.0, round_trip_s, hand=FAST).plan()
    axis = plan.slave["axes"][0]
    axis["limits"] = plan.master["axes"][0]["limits"] = {}
    axis["simulation"]["contact"]["effects"][0]["parameters"]["contact_position_m"] = CONTACT_M
    pair = Pair(plan.slave, plan.master)
    pair.to_slave.delay_s = pair.to_master.delay_s = round_trip_s / 2
    pair.run(DURATION_S)
    time_s, position_m, velocity_m_s, force_n = (
        pair.traffic.column(FORCE, name) for name in ("stamp_ns", "position_m", "velocity_m_s", "force_n")
    )
    later = time_s / S > KNOWN_S
    first = np.maximum.accumulate(position_m) < CONTACT_M
    ticks = sum(m.count for m in pair.traffic.messages(LIMIT_EVENT) if m.rule in ("contact_speed", "force"))
    slowed = 0.1 * ticks / DURATION_S
    fastest = [1e3 * velocity_m_s[part & (position_m < CONTACT_M)].max() for part in (first, later)]
    most = 100.0 * (np.abs(force_n).max() / LIMITS.max_force_n - 1.0)
    return f"{round_trip_s * 1e3:6.0f}{fastest[0]:12.1f}{fastest[1]:10.1f}{most:12.2f}{slowed:10.1f}"


def main() -> None:
    print("overshoot in %:   " + "".join(f"{1e3 * v:8.0f} mm/s" for v in SPEEDS_M_S) + "     stop")
    for stiffness_n_m in WALLS_N_M:
        met = [overshoot(stiffness_n_m, speed_m_s) for speed_m_s in SPEEDS_M_S]
        met.append(overshoot(stiffness_n_m, SPEEDS_M_S[-1], stops=True))
        print(f"{stiffness_n_m:6.0f} N/m       " + "".join(f"{each:13.1f}" for each in met), flush=True)
    seed = int(sys.argv[1]) if sys.argv[1:] else SEED
    print(f"{'':44}printed  reached   most N    ms to event")
    for name, changes in CASES.items():
        case = Case(**changes, seed=seed)
        case.pair.run(DURATION_S)
        print(f"{name:42}{case.row()}", flush=True)
    print("ms    fastest, mm/s: first     later   overshoot %   slowed %")
    for round_trip_s in ROUND_TRIPS_S:
        print(across(round_trip_s), flush=True)


if __name__ == "__main__":
    main()
