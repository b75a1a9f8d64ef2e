"""The bench that makes a motion: a cell that is simulated in virtual time, or a live one, by its own gate."""

import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from select import select
from typing import Any, TypeVar

from forefeel.calibrate.procedure import require_consent
from forefeel.child_process import ChildProcess
from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.events.text import quantity
from forefeel.common.messages import ForceSample, SafetyState, SlaveState
from forefeel.common.recording.recording import Recording
from forefeel.common.settings import AxisSettings, DaemonSettings
from forefeel.common.topics import FORCE, SLAVE_STATE
from forefeel.common.transport.security import Party
from forefeel.common.transport.settings import TransportSettings
from forefeel.common.yaml_file import dump_mapping
from forefeel.daemon_settings import load_daemon
from forefeel.diagnosis.excitation import ForceLimitMet, Limits, excitation
from forefeel.files import write_whole
from forefeel.interrupt import signal_flag
from forefeel.loopback.plan import Plan
from forefeel.loopback.virtual import VirtualLoopback
from forefeel.master.settings import MasterSettings
from forefeel.recorder import Recorder
from forefeel.results.investigation import motion_text
from forefeel.slave.settings import SlaveSettings
from forefeel.terminal import say

_A = TypeVar("_A", bound=AxisSettings)
_HELD_S, _NEAR = 0.5, 0.8
_GRACE_S = 60.0  # beyond the length of a motion, to arm and to go to its beginning
_STOPPED = frozenset({SafetyState.FAULT, SafetyState.ESTOPPED})
_APPROACH_M_S = 0.03  # m/s, fastest way to the beginning of a motion
_POLL_S = 0.05


class ForceLimitWatch:
    """Finds where a force of `limit_n` is met: beyond it, or near it for half a second, slowed by it."""

    def __init__(self, limit_n: float) -> None:
        self.met: ForceLimitMet | None = None
        self._limit_n = limit_n
        self._since_ns: int | None = None

    def take(self, sample: ForceSample) -> None:
        """Sets `met`, once: at a force over the limit, or one over 80 % of it that has held the slave back
        (`force_limited`) for 0.5 s; then to the time at which that began.
        """
        size_n, time_s = abs(sample.force_n), sample.recording_time_s or 0.0
        if not (sample.force_limited and size_n > _NEAR * self._limit_n):
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = sample.stamp_ns
        held = self._since_ns is not None and sample.stamp_ns - self._since_ns > _HELD_S * 1e9
        if self.met is None and (held or size_n > self._limit_n):
            time_s = max(time_s - (_HELD_S if held else 0.0), 0.0)
            self.met = ForceLimitMet(time_s, sample.position_m, sample.force_n > 0.0)


class SimulatedBench:
    """The simulated axis of a slave's settings in virtual time; the same bits for the same motion."""

    def __init__(self, settings: SlaveSettings, axis: str | None) -> None:
        """ConfigurationError: no such axis, or one with hardware."""
        self._axis = _chosen(settings.axes, axis)
        if any(section.hardware for section in self._axis.sections.values()):
            raise ConfigurationError(
                f"axis {self._axis.name}: --virtual-time expects simulated devices alone"
            )
        self._settings, self.limits = settings, _limits_of(self._axis)

    def ask(self, yes: bool) -> None:
        """Asks nobody: nothing moves."""

    def record_question(self, out: Path, duration_s: float) -> None:
        """Records the synthetic operator."""
        say("recording the synthetic operator")
        self._run({"driver": "operator"}, duration_s, out)

    def play(self, motion: Recording, out: Path) -> ForceLimitMet | None:
        """Plays a motion and records it as `out`; ends it where the force limit is met."""
        return self._run(_playing(motion, out, self.limits), None, out)

    def _run(self, handle: dict[str, object], duration_s: float | None, out: Path) -> ForceLimitMet | None:
        """Runs slave and master in virtual time and records them as `out`: for `duration_s`, or where that is
        None until the motion ends or the force limit is met. Returns the force limit that was met, or None.
        RunError: the slave stopped, or the motion did not end; `out` holds what was made until then.
        """
        slave, axis = _of_axis(self._settings, self._axis.name)
        master = {"name": axis["name"], "limits": axis["limits"], "handle": handle}
        plan = Plan(
            slave={**slave, "transport": {}},
            master={"cell": slave["cell"], "axes": [master]},
            duration_s=duration_s,
            expected_s=duration_s or _GRACE_S,
            notes=(),
            metadata={"recording": out.name},
        )
        loop, watch = VirtualLoopback(plan, 0), ForceLimitWatch(self.limits.force_n)
        watched, ended = 0, ""

        def look(_done_s: float) -> None:
            """Watches new messages; ends the run if the slave stops, or a motion meets the force limit."""
            nonlocal watched, ended
            for _, message, _ in loop.messages[watched:]:
                if isinstance(message, ForceSample):
                    watch.take(message)
                elif isinstance(message, SlaveState):
                    ended = ended or _stopped(message)
            watched = len(loop.messages)
            if ended or (watch.met is not None and duration_s is None):
                loop.end()

        with loop.recording(out):
            loop.run(look)
        if duration_s is None and watch.met is None and not loop.master.finished:
            ended = ended or "the motion did not end"
        if ended:
            raise RunError(f"{ended}; no verdict; {out} holds what was made until then")
        return watch.met


class LiveBench:
    """An axis of a live cell, moved by a master of its own through the slave's gate."""

    def __init__(self, settings: MasterSettings, axis: str | None, insecure: bool) -> None:
        """ConfigurationError: no such axis."""
        self._settings, self._axis = settings, _chosen(settings.axes, axis)
        self.limits, self._insecure = _limits_of(self._axis), insecure

    def ask(self, yes: bool) -> None:
        """Asks for consent to move the stage, unless `yes`. RunError: it was not given."""
        of = self.limits
        bounds = (
            f"{quantity(of.low_m, 'm')} to {quantity(of.high_m, 'm')}, up to {quantity(of.speed_m_s, 'm/s')}"
        )
        require_consent(f"The stage will move within {bounds}. Any key ends it", yes)

    def record_question(self, out: Path, duration_s: float) -> None:
        """Records the motion mirrored, so that of two motions each holds for the other."""
        say("recording the motion mirrored")
        motion, of = excitation(self.limits, duration_s), self.limits
        self.play(replace(motion, position_m=of.low_m + of.high_m - motion.position_m), out)

    def play(self, motion: Recording, out: Path) -> ForceLimitMet | None:
        """Plays a motion with a master of its own, whose settings it writes beside `out`, and records it as
        `out`; ends it where the force limit is met. RunError: a key was pressed, a signal came, the slave
        stopped, the motion did not end, or the master failed; `out` holds what was made until then.
        """
        config, cell = out.with_suffix(".yaml"), self._settings.cell
        master, axis = _of_axis(self._settings, self._axis.name)
        axis["handle"] = _playing(motion, out, self.limits)
        config.write_text(dump_mapping(master), encoding="utf-8")
        words = ("master", "--config", str(config), *(["--insecure"] if self._insecure else []))
        of, party, ended = self._settings.transport, Party("recorder", (cell,)), ""
        watch, until_s = ForceLimitWatch(self.limits.force_n), time.monotonic() + motion.duration_s + _GRACE_S
        transport = TransportSettings(connect=of.connect, pki=of.pki, mode=of.mode)
        recorder = Recorder(out, cell, transport, {"cell": cell}, party, self._insecure)
        child = ChildProcess(out.stem, words, out.parent)
        with closing(recorder), signal_flag() as stop, _key_pressed() as pressed, child:
            child.start()
            while child.running and watch.met is None and not ended:
                time.sleep(_POLL_S)
                recorder.check()
                if sample := recorder.latest(FORCE, self._axis.name):
                    watch.take(sample)
                state = recorder.latest(SLAVE_STATE, self._axis.name)
                if state is not None:
                    ended = _stopped(state)
                if pressed() or stop.wanted():
                    ended = "ended by hand"
                if time.monotonic() > until_s:
                    ended = f"the motion did not end (see {child.log})"
        if ended:
            raise RunError(f"{ended}; no verdict; {out} holds what was made until then")
        if watch.met is None:
            child.check()
        return watch.met


def bench_of(config: Path, virtual: bool, axis: str | None, insecure: bool) -> SimulatedBench | LiveBench:
    """The bench of a slave's settings, simulated, or of a master's, live. ConfigurationError: others, no such
    axis, or hardware in virtual time.
    """
    settings = load_daemon(config, "slave" if virtual else "master")
    if isinstance(settings, SlaveSettings):
        return SimulatedBench(settings, axis)
    return LiveBench(settings, axis, insecure)


def _chosen(axes: Sequence[_A], name: str | None) -> _A:
    """The axis of that name, or the first. ConfigurationError: there is none."""
    named = [axis for axis in axes if name in (None, axis.name)]
    if not named:
        expected = ", ".join(axis.name for axis in axes)
        raise ConfigurationError(f"--axis {name}: expected one of {expected}")
    return named[0]


def _of_axis(settings: DaemonSettings, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings of a daemon of that axis alone, as plain data, and those of the axis in them."""
    data = settings.model_dump(mode="json")
    data["axes"] = [axis for axis in data["axes"] if axis["name"] == name]
    return data, data["axes"][0]


@contextmanager
def _key_pressed() -> Iterator[Callable[[], bool]]:
    """Yields a function that is True once a key was pressed, always False without a terminal; the terminal
    hands on single keys, without echo, until the body ends.
    """
    if not sys.stdin.isatty():
        yield lambda: False
        return
    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield lambda: bool(select([sys.stdin], [], [], 0.0)[0])
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def _stopped(state: SlaveState) -> str:
    """Reason for the end of a motion; empty while it goes on."""
    return f"the slave is {state.state.value}: {state.reason}" if state.state in _STOPPED else ""


def _limits_of(axis: AxisSettings) -> Limits:
    of = axis.limits
    return Limits(*of.workspace_m, of.max_velocity_m_s, of.max_acceleration_m_s2, of.max_force_n)


def _playing(motion: Recording, out: Path, limits: Limits) -> dict[str, object]:
    """Writes a motion as CSV beside `out`; returns settings of a handle that plays it."""
    file = out.with_suffix(".csv")
    write_whole(file, motion_text(motion), "the motion")
    approach_m_s = min(_APPROACH_M_S, 0.5 * limits.speed_m_s)
    return {"driver": "recording", "recording": str(file.resolve()), "approach_m_s": approach_m_s}
