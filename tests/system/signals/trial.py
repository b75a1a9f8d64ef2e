"""One command, one signal at a random time, and what is left."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import yaml

from forefeel.common.recording.mcap_reader import Run
from tests.event_lines import read_events
from tests.live_cell import IMPORTS, Process, free_port
from tests.system.rows import Result
from tests.system.signals.cases import BENCH, CASES, LOOKS, MODEL, SLAVE, Case
from tests.unit.diagnosis_samples import FRICTION_N, made, put

# whoever runs under nohup, or behind a script's &, ignores signals, and so would what it starts
COMMAND = ["env", "--default-signal", sys.executable, "-m", "forefeel"]
SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
BOUND_S = 3.0
_MARK = "FOREFEEL_SIGNALS_TRIAL"
_PATIENCE_S = 60.0
_BEGINS_S = 15.0
"""More than any command needs to be at work on a busy machine."""
_AT_ONCE = 6
"""Commands that run at the same time, so that two cores have always too much to do."""
_AT_WORK = 0.75
"""Share of the signals that find what is more than looked around at work; the others come while it starts."""


@dataclass(frozen=True)
class Trial:
    """`delay_s` counts from when Python has begun with the command, or from when it is at work."""

    number: int
    case: Case
    signal: signal.Signals
    at_work: bool
    delay_s: float

    def __str__(self) -> str:
        since = "at work for" if self.at_work else "started for"
        return f"{self.number}: {self.case.name}, {self.signal.name}, {since} {self.delay_s:.2f} s"


def environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": IMPORTS, "XDG_STATE_HOME": str(folder), "PYTHONDONTWRITEBYTECODE": ""}


@contextmanager
def scene(folder: Path) -> Iterator[int]:
    """Makes the recordings, runs a slave, two devices and for each processor a process that computes; the
    slave's port.
    """
    port = free_port()
    (folder / "long").mkdir()
    for name in "ab":
        put(folder / "long" / f"{name}.csv", made(60.0, friction_n=FRICTION_N, bias_n=0.05))
    (folder / "slave.yaml").write_text(SLAVE.replace("PORT", str(port)).replace("HERE", str(folder)))
    (folder / "bench.yaml").write_text(BENCH.replace("DIR", str(folder)))
    (folder / "m.yaml").write_text(MODEL)
    for line in (
        f"loopback --virtual-time --duration 10 --out {folder}/run",
        f"pki init {folder}/pki --cell one",
    ):
        subprocess.run([*COMMAND, *line.split()], env=environment(folder), check=True, capture_output=True)
    with ExitStack() as running:
        for role, ready, line in (
            ("slave", "waiting for a master", "slave --config slave.yaml"),
            ("cell", "baud", "emulate bota_serial --config bench.yaml"),
            ("stage", "baud", "emulate zaber_ascii --config bench.yaml"),
        ):
            process = Process(role, folder, *line.split(), environment={"XDG_STATE_HOME": str(folder)})
            running.callback(process.kill)
            process.wait_for(ready)
        for _ in range(os.cpu_count() or 1):
            busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            running.callback(busy.wait)
            running.callback(busy.kill)
        yield port


def trials(count: int, seed: int) -> list[Trial]:
    """Every command as often as every other, within one."""
    draw = random.Random(seed)
    drawn: list[Trial] = []
    while len(drawn) < count:
        for case in draw.sample(CASES, len(CASES)):
            at_work = case.ends != LOOKS and draw.random() < _AT_WORK
            delay_s = draw.uniform(0.0, case.within_s)
            drawn.append(Trial(len(drawn), case, draw.choice(SIGNALS), at_work, delay_s))
    return drawn[:count]


def random_signals(folder: Path, count: int = 60) -> Result:
    """Signals over every command on a busy machine, and Ctrl-C in long diagnoses."""
    ready = folder / "ready"
    ready.mkdir()
    long = next(case for case in CASES if case.name == "diagnose a folder")
    wanted = [*trials(count, 1), *(Trial(1000 + n, long, signal.SIGINT, True, 1.5 * n) for n in range(4))]
    with scene(ready) as port, ThreadPoolExecutor(_AT_ONCE - 1) as pool, ThreadPoolExecutor(1) as one_by_one:
        pools = [one_by_one if trial.case.shares else pool for trial in wanted]
        ends = [it.submit(run, trial, ready, port, folder) for it, trial in zip(pools, wanted, strict=True)]
        try:
            results = [end.result() for end in ends]
        finally:  # whoever ends us waits for no command, neither for one to come nor for one that hangs
            for end in ends:
                end.cancel()
            while not all(end.done() for end in ends):
                _kill(f"{os.getpid()}.")
                time.sleep(0.05)
    longest_s = max(seconds for seconds, _ in results)
    failures = [f"{trial}: {it}" for trial, (_, wrong) in zip(wanted, results, strict=True) for it in wrong]
    figures = f"{len(results)} signals, the last ended after {longest_s:.2f} s (bound {BOUND_S:g} s)"
    return Result(figures, failures)


def run(trial: Trial, ready: Path, port: int, folder: Path) -> tuple[float, list[str]]:
    """Starts the command, sends the signal as a terminal or a service manager does, looks at what is left.

    Returns s from the signal to the end, and what is wrong.
    """
    here = folder / str(trial.number)
    here.mkdir()
    places = {"HERE": str(here), "READY": str(ready), "CELL": str(port), "PORT": str(free_port())}
    for name, text in trial.case.files:
        (here / name).write_text(_placed(text, places))
    mark = f"{os.getpid()}.{here}."
    with (here / "stderr").open("wb") as errors, (here / "stdout").open("wb") as out:
        process = subprocess.Popen(
            [*COMMAND, *_placed(trial.case.line, places).split()],
            env={**environment(here), _MARK: mark},
            stdin=subprocess.DEVNULL, stdout=out, stderr=errors, process_group=0,
        )  # fmt: skip
        try:
            seconds = _struck(process, trial)
            end_s = time.monotonic() + 1.0 + BOUND_S - seconds
            while (left := list(_marked(mark))) and time.monotonic() < end_s:
                time.sleep(0.05)
        finally:
            _kill(mark)
            process.wait()
    wrong = [*_wrong_end(trial, process.returncode, (here / "stderr").read_text()), *_half_written(here)]
    if left:
        wrong.append(f"left processes {left}")
    if seconds > BOUND_S:
        wrong.append(f"ended after {seconds:.2f} s")
    return seconds, wrong


def _struck(process: "subprocess.Popen[bytes]", trial: Trial) -> float:
    """Sends the signal when it is due, unless the command has finished by then; s from there to its end."""
    _await_begin(process, trial.at_work)
    with suppress(subprocess.TimeoutExpired):
        process.wait(trial.delay_s)
        return 0.0
    start_s = time.monotonic()
    with suppress(ProcessLookupError):  # a service manager tells the process, a terminal its group
        if trial.signal == signal.SIGTERM:
            process.send_signal(trial.signal)
        else:
            os.killpg(process.pid, trial.signal)
    try:
        process.wait(_PATIENCE_S)
    except subprocess.TimeoutExpired as error:
        raise AssertionError(f"{trial}: runs on for {_PATIENCE_S:g} s") from error
    return time.monotonic() - start_s


def _placed(text: str, places: dict[str, str]) -> str:
    for name, place in places.items():
        text = text.replace(name, place)
    return text


def _await_begin(process: "subprocess.Popen[bytes]", at_work: bool) -> None:
    """Waits until the command has taken SIGINT from Python, which would show a traceback, and until it
    catches it by itself, as it does at work. A change that was too short to be seen is not waited for.
    """
    end_s = time.monotonic() + _BEGINS_S
    for caught in (True, False, True) if at_work else (True, False):
        while process.poll() is None and _catches_sigint(process.pid) != caught:
            if time.monotonic() > end_s:
                return
            time.sleep(0.001)


def _catches_sigint(pid: int) -> bool:
    with suppress(OSError):
        status = Path(f"/proc/{pid}/status").read_text()
        return bool(int(status.partition("SigCgt:")[2].split()[0], 16) & 1 << signal.SIGINT - 1)
    return False


def _marked(mark: str) -> Iterator[int]:
    """Living processes that descend from a command whose mark begins so."""
    sought = f"{_MARK}={mark}".encode()
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            zombie = (path / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
            if not zombie and any(
                each.startswith(sought) for each in (path / "environ").read_bytes().split(b"\0")
            ):
                yield int(path.name)


def _kill(mark: str) -> None:
    for pid in _marked(mark):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _wrong_end(trial: Trial, code: int, words: str) -> Iterator[str]:
    if "Traceback" in words:
        yield f"traceback: {words[-400:]}"
    if code == -trial.signal:
        return  # before it began, or where there is nothing to close
    if code not in trial.case.ends:
        yield f"exit code {code}: {words[-300:]}"
    errors = [line.startswith("forefeel: ") for line in words.splitlines()]
    if code and trial.case.ends != LOOKS and not (sum(errors) == 1 and errors[-1]):
        yield f"not one line at the end: {words[-300:]}"


def _half_written(here: Path) -> Iterator[str]:
    for path in sorted(here.rglob("*")):
        if ".part" in path.name or path.is_symlink():
            yield f"left {path.relative_to(here)}"
        elif path.is_file():
            try:
                _parse(path)
            except Exception as error:  # noqa: BLE001 - whatever it is, the file is not whole
                yield f"{path.relative_to(here)}: {type(error).__name__}: {error}"


def _parse(path: Path) -> None:
    """Raises what it likes for a file that is not whole."""
    content = path.read_bytes()
    match path.suffix:
        case ".json":
            json.loads(content)
        case ".yaml":
            yaml.safe_load(content)
        case ".html":
            assert content.rstrip().endswith(b"</html>")
        case ".png":
            assert content.endswith(b"IEND\xaeB`\x82")
        case ".csv":
            rows = content.splitlines()
            assert content.endswith(b"\n") and all(row.count(b",") == rows[0].count(b",") for row in rows)
        case ".crt" | ".key":
            assert content.rstrip().endswith(b"-----")
        case ".mcap":
            assert not Run(path).truncated
        case ".jsonl":
            assert read_events(path)[-1].event == "stop"
