"""What the hand feels at a wall across a delay: `python -m benchmarks.felt_force`, in virtual time.

Each row is a run of 18 s: strokes of 15 mm against a wall without friction 3 mm from their start, both
daemons on one bus whose links have half of the round trip each. Per row:

- lowest E in mJ, E(n) = sum f(k - 1 - late) (x(k) - x(k - 1)): what the hand has put into the handle, with
  the actuator as late as its driver states; and with others that apply the force at once, or some ticks late
  (the same motion);
- change of the felt force per tick in mN, its 99.9th percentile and its largest, without the 0.5 s after an
  engagement that follows a stop; the largest in these 0.5 s alone;
- R, the rms error of the felt force in N, and the share of time in which it is within one just noticeable
  difference (`forefeel.report.transparency`): while the predictor learns (4 to 10 s) / later (10 to 18 s);
- the largest distance in mm of the stage from where the command that it executes wants it, from 4 s on.

R and errors count what the hand can have: true and late force within its 4 N. A row `1 ms late` has an
actuator that is, and says so (`actuator_delay_s`). Beside the product's own rows, under the same passivity
limit: the newest force that has arrived (`rendering.source: zoh`), and the true force in place of the
predicted one. And two controllers of the literature, tuned as `benchmarks.bilateral` says.
Arguments: words, of which each row's name has one (default: all rows); a number is a seed (default: two).
"""

import sys
import time
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.bilateral import PEERS, Peer, Trace, simulate
from benchmarks.markdown import Table
from forefeel.common.causes.model import SCHEMA
from forefeel.common.clock import VirtualClock
from forefeel.common.estimation.evaluator import Estimate
from forefeel.common.messages import MotionCommand, within
from forefeel.common.topics import COMMAND, FORCE, HAPTICS
from forefeel.loopback.plan import LoopbackOptions, Plan, make_plan
from forefeel.master.daemon import make_handle
from forefeel.master.handle import Handle, HandleReading
from forefeel.report.transparency import Twin, transparency
from tests.simulation.pair import Pair, S

SEED = 1  # of operator and load cell; arbitrary
SEEDS = (SEED, 7)
LATE = (0, 1, 3, 5)  # ticks that an actuator may be late
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
LOOSER = {"arm_mass_kg": 0.1, "arm_damping_n_s_m": 1.5, "arm_stiffness_n_m": 40.0}
TAPPING = {"insert_s": 0.22, "withdraw_s": 0.22, "dwell_s": 0.02, "depth_m": 0.012}
SHAKING = {"tremor_m": 0.0012}
STIFF = {"arm_mass_kg": 0.6, "arm_damping_n_s_m": 40.0, "arm_stiffness_n_m": 1000.0, "depth_m": 0.006}
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Row:
    """`stiffness_n_m` None: the world of the demo. From `JUMP_S` on: `later_s`, the round trip, and `ratio`,
    of the wall's stiffness. `hand`: settings of the operator. `source`: of the force, see
    `RenderingSettings`, or "true". `late`: ticks, of the actuator. `again`: a run of another operator came
    before, whose prior this one loads.
    """

    name: str
    stiffness_n_m: float | None
    round_trip_s: float
    later_s: float | None = None
    ratio: float = 1.0
    cuts_s: tuple[tuple[float, float], ...] = ()
    hand: dict[str, float] = field(default_factory=dict)
    source: str = "predicted"
    late: int = 0
    again: bool = False

    def plan(self, seed: int = SEED, prior_dir: Path | None = None) -> Plan:
        """Settings of both ends, at a wall with a force limit that the hand does not reach."""
        plan = make_plan(LoopbackOptions(seed=seed, prior_dir=prior_dir))
        slave, master = plan.slave["axes"][0], plan.master["axes"][0]
        master["handle"] |= self.hand | {"actuator_delay_s": self.late * 1e-3}
        master["rendering"] |= {"source": "zoh" if self.source == "zoh" else "predicted"}
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
    Row("demo catheter, second run, 300 ms", None, 0.3, again=True),
)
HANDS = tuple(
    Row(f"{name} {stiffness_n_m:g} N/m 300 ms", stiffness_n_m, 0.3, hand=hand)
    for name, hand, further_n_m in (
        ("tapping", TAPPING, (8000.0,)), ("shaking", SHAKING, ()), ("looser hand", LOOSER, (2000.0,)),
    )
    for stiffness_n_m in (800.0, 1500.0, 3000.0, *further_n_m)
)  # fmt: skip
LATE_ROWS = tuple(
    replace(row, name=f"{row.name}, {late} ms late", late=late) for row in (*ROWS, *HANDS) for late in (1, 3)
)
HELD = tuple(replace(row, name=f"held force, {row.name}", source="zoh") for row in STEADY)
TRUE = tuple(
    replace(row, name=f"true force, {row.name}", source="true")
    for row in (*STEADY, *ROWS[-4:-2], *HANDS, *LATE_ROWS[2 * len(ROWS) :])
)


@dataclass(frozen=True, slots=True)
class LimitedRow(Row):
    """At a force limit that the hand reaches. `loss`: share of the messages. `stage_hz`: of its bandwidth."""

    loss: float = 0.0
    stalls_s: tuple[tuple[float, float], ...] = ()
    stage_hz: float = 25.0

    def plan(self, seed: int = SEED, prior_dir: Path | None = None) -> Plan:
        plan = Row.plan(self, seed, prior_dir)
        slave, master = plan.slave["axes"][0], plan.master["axes"][0]
        slave["limits"] = master["limits"] = {"max_force_n": 3.0}
        slave["simulation"]["stage"] = {"bandwidth_hz": self.stage_hz}
        return plan


STALLS_S = tuple((1.0 + 0.4 * n, 1.05 + 0.4 * n) for n in range(round(DURATION_S / 0.4)))
LIMITED = (
    *(LimitedRow(f"limit 3 N, {wall:g} N/m 300 ms", wall, 0.3) for wall in (300.0, 1000.0, 3000.0)),
    LimitedRow("limit 3 N, 1000 N/m 300 ms, 10 % lost", 1000.0, 0.3, loss=0.1),
    LimitedRow("limit 3 N, 1500 N/m 450 ms", 1500.0, 0.45),
    LimitedRow("limit 3 N, 1000 N/m 300 ms, stalls of 50 ms", 1000.0, 0.3, stalls_s=STALLS_S),
    LimitedRow("limit 3 N, 3000 N/m 300 ms, stage of 8 Hz", 3000.0, 0.3, stage_hz=8.0),
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


class Felt:
    """A row's run, and what is measured of it."""

    def __init__(self, row: Row, seed: int) -> None:
        self._row = row
        with TemporaryDirectory() as folder:
            prior_dir = Path(folder) if row.again else None
            if row.again:
                first = Pair(*_ends(row.plan(seed + 1, prior_dir)))
                self._run(first)
                first.master.shut_down()
                first.run(1.0)
                first.master.close(first.runtime.clock.now_ns())
            plan = row.plan(seed, prior_dir)
            self._pair = Pair(*_ends(plan))
            self.actuator = Actuator(self._pair.master.axes[0].handle)
            self._axis = plan.slave_settings().axes[0]
            rendering = plan.master_settings().axes[0].rendering
            self._scale = rendering.force_scale
            self._most_n = rendering.max_force_n / rendering.force_scale
            self._start_ns = self._pair.runtime.clock.now_ns()
            if row.source == "true":
                self._render_truth()
            self._run(self._pair)

    def _run(self, pair: Pair) -> None:
        row = self._row
        for cable in (pair.to_slave, pair.to_master):
            cable.delay_s = row.round_trip_s / 2
            cable.cuts = [(1.0 + start_s, 1.0 + end_s) for start_s, end_s in row.cuts_s]
            if isinstance(row, LimitedRow):
                cable.stalls, cable.loss = list(row.stalls_s), row.loss
        pair.run(JUMP_S)
        if row.later_s is not None:
            pair.to_slave.delay_s = pair.to_master.delay_s = row.later_s / 2
        pair.run(DURATION_S - JUMP_S)
        # observers hear haptic samples in batches of 20 ms: the last one of a run is not full
        pair.master.axes[0].flush(pair.runtime.clock.now_ns())

    def _twin(self) -> Twin:
        return Twin(self._axis, self._start_ns + S // 1000, round(self._row.round_trip_s / 2 * S))

    def _render_truth(self) -> None:
        """Has the prediction say what the twin answers."""
        prediction, twin = self._pair.master.axes[0]._loop.prediction, self._twin()
        predict = prediction.predict

        def true(*motion_and_learned: Any) -> Estimate | None:  # noqa: ANN401 - see `ForcePrediction.predict`
            stamp_ns, position_m, velocity_m_s, deadman = motion_and_learned[:4]
            command = MotionCommand(
                session_id=0, sequence=0, stamp_ns=stamp_ns,
                position_m=position_m, velocity_m_s=velocity_m_s, deadman=deadman,
            )  # fmt: skip
            force_n = twin.force_n(command)
            predicted = predict(*motion_and_learned)
            return None if predicted is None else predicted._replace(force_n=force_n)

        vars(prediction).update(predict=true)

    def again(self) -> Flags:
        """The changes of the force after a further arming."""
        stamps_ns = np.array(self.actuator.stamps_ns[1:])
        found = np.zeros(len(stamps_ns), bool)
        for engaged_s in self._pair.traffic.times("engage")[1:]:
            # the master hears of it half a round trip later
            later_s = stamps_ns / S - engaged_s - self._row.round_trip_s / 2
            found |= (later_s >= 0.0) & (later_s < SETTLED_S)
        return found

    def trace(self) -> Trace:
        """Of each command that the slave followed."""
        traffic = self._pair.traffic
        stage_m = {sample.answers_sequence: sample.position_m for sample in traffic.messages(FORCE)}
        haptics = {sample.sequence: sample for sample in traffic.messages(HAPTICS)}
        twin, most_n = self._twin(), self._most_n
        rows = []
        for command in traffic.messages(COMMAND):
            true_n, haptic = twin.force_n(command), haptics[command.sequence]
            if command.sequence in stage_m and haptic.zoh_n is not None:
                time_s, behind_m = (command.stamp_ns - self._start_ns) / S, stage_m[command.sequence]
                felt_n, held_n = haptic.rendered_n / self._scale, within(haptic.zoh_n, most_n)
                true_n = within(true_n, most_n)
                rows.append((time_s, felt_n, held_n, true_n, behind_m - command.position_m))
        return Trace(*np.array(rows).T)


def _ends(plan: Plan) -> tuple[dict[str, Any], dict[str, Any]]:
    return plan.slave, plan.master


def best(peer: Peer, row: Row, seed: int) -> tuple[str, Actuator, Trace]:
    """The best tuning of a peer at a row's wall, its handle and its trace."""
    plan, found = row.plan(seed), list[tuple[bool, float, str, Actuator, Trace]]()
    slave, master = plan.slave_settings().axes[0], plan.master_settings().axes[0]
    for name, make in peer.tunings.items():
        actuator = Actuator(handle := make_handle(master.handle, VirtualClock(0)))
        controller = make(master.rendering.max_force_n)
        trace = simulate(controller, handle, slave, row.round_trip_s / 2, DURATION_S)
        error_n = (trace.felt_n - trace.true_n)[trace.time_s > LEARNING_S[0]]
        gives = actuator.lowest_mj(0) < -1.0
        found.append((gives, float(np.mean(error_n**2)), name, actuator, trace))
    return min(found, key=lambda each: each[:2])[2:]


def cells(actuator: Actuator, again: Flags, trace: Trace, stated: int = 0) -> list[str]:
    """A row of the table, but its name."""
    steps_mn = 1e3 * np.abs(np.diff(actuator.forces_n))
    usual_mn = steps_mn[~again]
    steps = np.percentile(usual_mn, 99.9), usual_mn.max(), steps_mn[again].max(initial=0.0)
    spans = [(trace.time_s >= start) & (trace.time_s < end) for start, end in (LEARNING_S, LEARNED_S)]
    scores = [transparency(trace.felt_n[span], trace.held_n[span], trace.true_n[span]) for span in spans]
    drift_mm = 1e3 * np.abs(trace.behind_m[trace.time_s > LEARNING_S[0]]).max()
    return [
        f"{actuator.lowest_mj(stated) + 0.0:.2f}",
        " / ".join(f"{actuator.lowest_mj(late) + 0.0:.2f}" for late in LATE),
        " / ".join(f"{step_mn:.0f}" for step_mn in steps),
        " / ".join(f"{score.ratio or 0.0:.3f}" for score in scores),
        " / ".join(f"{score.felt.rms_n or 0.0:.3f}" for score in scores),
        " / ".join(f"{score.within_jnd or 0.0:.0%}" for score in scores),
        f"{drift_mm:.2f}",
    ]


def main(words: list[str]) -> None:
    """Prints the table, a row as soon as it is known."""
    start_s = time.process_time()
    seeds = [int(word) for word in words if word.isdecimal()] or SEEDS
    parts = [word for word in words if not word.isdecimal()]
    late = " / ".join(map(str, LATE))
    heads = [
        "row", "seed", "lowest E, as late as stated, mJ", f"lowest E, {late} ms late, mJ",
        "step, p99.9 / most / again, mN/ms", "R, learning / learned", "error, N", "within a JND",
        "stage behind, mm",
    ]  # fmt: skip
    table = Table(heads, "python -m benchmarks.felt_force")
    for row, seed in product((*ROWS, *HANDS, *LATE_ROWS, *LIMITED, *HELD, *TRUE), seeds):
        if not parts or any(part in row.name for part in parts):
            felt = Felt(row, seed)
            table.add([row.name, seed, *cells(felt.actuator, felt.again(), felt.trace(), row.late)])
    for peer, row, seed in product(PEERS, STEADY, seeds):
        if not parts or any(part in f"{peer.name}, {row.name}" for part in parts):
            tuning, actuator, trace = best(peer, row, seed)
            none = np.zeros(len(actuator.forces_n) - 1, bool)
            table.add([f"{peer.name}, {row.name}: {tuning}", seed, *cells(actuator, none, trace)])
    print(f"\n{DURATION_S:g} s in virtual time; {time.process_time() - start_s:.0f} s of one core")


if __name__ == "__main__":
    main(sys.argv[1:])
