"""What the hand feels at a wall across a delay: `python -m benchmarks.felt_force`, in virtual time.

Each row is a run of 18 s: strokes of 15 mm against a wall without friction 3 mm from their start, both
daemons on one bus whose links have half of the round trip each. Per row:

- lowest E in mJ, E(n) = sum f(k - 1 - late) (x(k) - x(k - 1)): what the hand has put into the handle, with an
  actuator that applies the force at once and one that applies it a tick later (the same motion);
- change of the felt force per tick in mN, its 99.9th percentile and its largest, without the 0.5 s after an
  engagement that follows a stop; the largest in these 0.5 s alone;
- R = rms(felt - true) / rms(held - true) while the predictor learns (4 to 10 s) and later (10 to 18 s), over
  the ticks in which the slave follows; and rms(felt - true) in N. True: the force with which a noise-free
  twin of the world answers the command of this tick. Held: the newest force that has arrived. Felt: at the
  hand, over `force_scale`.

Arguments: words, of which each row's name has one (default: all rows).
"""

import sys
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forefeel.common.causes.model import SCHEMA
from forefeel.common.limiter import MotionLimiter
from forefeel.common.messages import MotionCommand
from forefeel.common.topics import COMMAND, FORCE, HAPTICS
from forefeel.loopback.plan import LoopbackOptions, Plan, make_plan
from forefeel.master.handle import Handle, HandleReading
from forefeel.slave.plant.world import SimulatedWorld
from forefeel.slave.settings import SlaveAxisSettings
from tests.simulation.pair import Pair, S

SEED = 1  # of operator and load cell; arbitrary
DURATION_S = 18.0
LEARNING_S, LEARNED_S = (4.0, 10.0), (10.0, DURATION_S)
SETTLED_S = 0.5
"""After an engagement: the gate's ramp, and the fade of the force."""
JUMP_S = 10.0  # s, when delay or wall of a row change
CUTS_S = ((7.0, 7.6), (11.5, 12.1))
"""Spans without a link, each during a stroke in contact; longer than the watchdog, and ended by an arming."""
CONTACT_M = 0.008  # m, where the wall begins
STROKE = {"depth_m": 0.015}
LOOSE = {"arm_mass_kg": 0.15, "arm_damping_n_s_m": 3.0, "arm_stiffness_n_m": 60.0}
STIFF = {"arm_mass_kg": 0.6, "arm_damping_n_s_m": 40.0, "arm_stiffness_n_m": 1000.0, "depth_m": 0.006}
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Row:
    """`stiffness_n_m` None: the world of the demo. From `JUMP_S` on: `later_s`, the round trip, and `ratio`,
    of the wall's stiffness. `hand`: settings of the operator.
    """

    name: str
    stiffness_n_m: float | None
    round_trip_s: float
    later_s: float | None = None
    ratio: float = 1.0
    cuts_s: tuple[tuple[float, float], ...] = ()
    hand: dict[str, float] = field(default_factory=dict)

    def plan(self) -> Plan:
        """Settings of both ends, at a wall with a force limit that the hand does not reach."""
        plan = make_plan(LoopbackOptions(seed=SEED))
        slave, master = plan.slave["axes"][0], plan.master["axes"][0]
        master["handle"] |= self.hand
        if self.stiffness_n_m is not None:
            master["handle"] = STROKE | master["handle"]
            slave["limits"] = master["limits"] = {"max_force_n": 40.0}
            slave["simulation"] |= {
                "contact": self._wall(self.stiffness_n_m),
                "load_cell": {"full_scale_n": 50.0},
            }
        return plan

    def _wall(self, stiffness_n_m: float) -> dict[str, Any]:
        wall = {"mass_kg": 0.01, "damping_n_s_m": 0.4, "stiffness_n_m": stiffness_n_m}
        effects: dict[str, dict[str, float]] = {
            "contact_loss": {"contact_position_m": CONTACT_M},
            "mass_damper_spring": wall,
        }
        if self.ratio != 1.0:
            change = {"stiffness_n_m": stiffness_n_m, "time_s": JUMP_S, "ratio": self.ratio}
            effects["stiffness_change"] = change
        entries = [{"effect": name, "parameters": values} for name, values in effects.items()]
        return {"schema": SCHEMA, "name": "wall", "effects": entries}


STEADY = tuple(
    Row(f"steady {stiffness_n_m:g} N/m {round_trip_s * 1e3:g} ms", stiffness_n_m, round_trip_s)
    for round_trip_s in (0.3, 0.6)
    for stiffness_n_m in (200.0, 1000.0, 3000.0)
)
ROWS = (
    *STEADY,
    Row("reconnecting 1000 N/m 300 ms", 1000.0, 0.3, cuts_s=CUTS_S),
    Row("delay 300 to 600 ms 1000 N/m", 1000.0, 0.3, later_s=0.6),
    Row("wall 200 to 1000 N/m 300 ms", 200.0, 0.3, ratio=5.0),
    Row("wall 600 to 3000 N/m 300 ms", 600.0, 0.3, ratio=5.0),
    Row("loose hand 3000 N/m 300 ms", 3000.0, 0.3, hand=LOOSE),
    Row("stiff hand 3000 N/m 300 ms", 3000.0, 0.3, hand=STIFF),
    Row("demo catheter 300 ms", None, 0.3),
)


class Actuator:
    """Takes the place of a handle's `read` and `render`, and keeps what was read and applied in each tick."""

    def __init__(self, handle: Handle) -> None:
        self.stamps_ns: list[int] = []
        self.positions_m: list[float] = []
        self.forces_n: list[float] = []
        self._read, self._render = handle.read, handle.render
        vars(handle).update(read=self.read, render=self.render)

    def read(self, now_ns: int) -> HandleReading:
        reading = self._read(now_ns)
        self.stamps_ns.append(now_ns)
        self.positions_m.append(reading.position_m)
        return reading

    def render(self, force_n: float, now_ns: int) -> float:
        applied_n = self._render(force_n, now_ns)
        self.forces_n.append(applied_n)
        return applied_n

    def lowest_mj(self, late: int) -> float:
        """Lowest energy that the hand has put in, in mJ, with the force `late` ticks late."""
        moved_m = np.diff(self.positions_m)[late:]
        given_j = np.array(self.forces_n[: len(moved_m)]) * moved_m
        return 1e3 * float(min(0.0, np.cumsum(given_j).min()))


class Twin:
    """The slave's world without noise, which gets each command at once: limits, stage, contact, load cell.

    Its clock runs `ahead_ns` before the commands' stamps, as the world's does in which they arrive.
    """

    def __init__(self, settings: SlaveAxisSettings, start_ns: int, ahead_ns: int) -> None:
        cell = settings.simulation.load_cell.model_copy(update={"noise_n": 0.0})
        self._world = SimulatedWorld(
            settings.simulation.model_copy(update={"load_cell": cell}), settings.seed
        )
        self._world.advance(start_ns)
        self._limiter = MotionLimiter(settings.limits, settings.gate.stop_deceleration_m_s2)
        self._ahead_ns = ahead_ns

    def force_n(self, command: MotionCommand) -> float:
        """The force in N that answers a command, a tick after it arrives."""
        if command.deadman:
            self._limiter.follow(command.position_m, command.velocity_m_s, 0.0, 1e-3)
        else:
            self._limiter.place(command.position_m)
        arrived_ns = command.stamp_ns + self._ahead_ns
        self._world.set_target(self._limiter.position_m, self._limiter.velocity_m_s, arrived_ns)
        self._world.advance(arrived_ns + S // 1000)
        return self._world.load_cell_reading().force_n


class Felt:
    """A row's run, and what is measured of it."""

    def __init__(self, row: Row) -> None:
        plan = row.plan()
        self._pair = Pair(plan.slave, plan.master)
        self.actuator = Actuator(self._pair.master.axes[0].handle)
        self._settings = plan.slave_settings().axes[0]
        self._scale = plan.master_settings().axes[0].rendering.force_scale
        self._start_ns = self._pair.runtime.clock.now_ns()
        self._row = row
        for cable in (self._pair.to_slave, self._pair.to_master):
            cable.delay_s = row.round_trip_s / 2
            cable.cuts = [(1.0 + start_s, 1.0 + end_s) for start_s, end_s in row.cuts_s]
        if row.later_s is None:
            self._pair.run(DURATION_S)
            return
        self._pair.run(JUMP_S)
        self._pair.to_slave.delay_s = self._pair.to_master.delay_s = row.later_s / 2
        self._pair.run(DURATION_S - JUMP_S)

    def steps_mn(self) -> tuple[float, float, float]:
        """Changes of the felt force per tick: 99.9th percentile, largest; largest after a further arming."""
        stamps_ns = np.array(self.actuator.stamps_ns[1:])
        steps_mn = 1e3 * np.abs(np.diff(self.actuator.forces_n))
        again = np.zeros(len(steps_mn), bool)
        for engaged_s in self._pair.heard.times("engage")[1:]:
            # the master hears of it half a round trip later
            later_s = stamps_ns / S - engaged_s - self._row.round_trip_s / 2
            again |= (later_s >= 0.0) & (later_s < SETTLED_S)
        usual_mn = steps_mn[~again]
        return (
            float(np.percentile(usual_mn, 99.9)),
            float(usual_mn.max()),
            float(steps_mn[again].max(initial=0.0)),
        )

    def errors_n(self) -> tuple[Floats, Floats, Floats]:
        """Of each command that the slave followed: time in s, error of the felt and of the held force."""
        heard = self._pair.heard
        answered = {sample.answers_sequence for sample in heard.messages(FORCE)}
        haptics = {sample.sequence: sample for sample in heard.messages(HAPTICS)}
        twin = Twin(self._settings, self._start_ns, round(self._row.round_trip_s / 2 * S))
        rows = []
        for command in heard.messages(COMMAND):
            true_n, haptic = twin.force_n(command), haptics[command.sequence]
            if command.sequence in answered and haptic.zoh_n is not None:
                felt_n = haptic.rendered_n / self._scale
                time_s = (command.stamp_ns - self._start_ns) / S
                rows.append((time_s, felt_n - true_n, haptic.zoh_n - true_n))
        times_s, felt_n, held_n = np.array(rows).T
        return times_s, felt_n, held_n


def ratio(errors_n: tuple[Floats, Floats, Floats], span_s: tuple[float, float]) -> tuple[float, float]:
    """R in a span, and the rms error of the felt force in N."""
    time_s, felt_n, held_n = errors_n
    inside = (time_s >= span_s[0]) & (time_s < span_s[1])
    felt_rms_n, held_rms_n = (float(np.sqrt(np.mean(each[inside] ** 2))) for each in (felt_n, held_n))
    return felt_rms_n / held_rms_n, felt_rms_n


def main(words: list[str]) -> None:
    """Prints the table, a row as soon as it is known."""
    print(f"{DURATION_S:g} s in virtual time, seed {SEED}; E in mJ, steps in mN; learning / learned")
    print(f"{'row':32}{'E':>9}{'late':>9}{'p99.9':>7}{'most':>7}{'again':>7}{'R':>15}{'error, N':>17}")
    start_s = time.process_time()
    for row in ROWS:
        if words and not any(word in row.name for word in words):
            continue
        felt = Felt(row)
        errors_n = felt.errors_n()
        (early, early_n), (late, late_n) = (ratio(errors_n, span_s) for span_s in (LEARNING_S, LEARNED_S))
        energies = "".join(f"{felt.actuator.lowest_mj(late_ticks):9.2f}" for late_ticks in (0, 1))
        steps = "".join(f"{step_mn:7.0f}" for step_mn in felt.steps_mn())
        errors = f"{early:7.3f} /{late:6.3f}{early_n:9.3f} /{late_n:6.3f}"
        print(f"{row.name:32}{energies}{steps}{errors}", flush=True)
    print(f"{time.process_time() - start_s:.0f} s of one core")


if __name__ == "__main__":
    main(sys.argv[1:])
