"""`forefeel estop` beside a daemon: by the standard library alone, whatever else is broken on that host."""

import asyncio
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from forefeel.common.settings import DaemonSettings
from forefeel.common.state.folder import SOCKET, state_path
from forefeel.control_socket import ControlSocket
from forefeel.daemon_settings import load_any
from forefeel.local import estop
from forefeel.local.client import Answer, Request
from tests.commands.command_line import ROOT, group

Run = Callable[[Sequence[str]], int]
Done = subprocess.CompletedProcess[str]
SLAVE = "role: slave\nstate: {directory: st}\ntransport: {listen: ['tcp/127.0.0.1:1']}\n"
HEAVY = (
    "pydantic",
    "pydantic_core",
    "typer",
    "zenoh",
    "numpy",
    "matplotlib",
    "rich",
    "msgpack",
    "cryptography",
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "slave.yaml").write_text(SLAVE)
    (tmp_path / "st").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def beside_a_daemon(folder: Path, act: Callable[[], Done], done: bool = True) -> tuple[Done, list[Request]]:
    """What `act` gave while a daemon answered in `folder`/st, and what that was asked."""
    asked: list[Request] = []

    async def answer(request: Request, by: str) -> Answer:
        del by
        asked.append(request)
        return Answer(done, ("axis insertion: estopped, pressed",), "slave")

    async def main() -> Done:
        with ControlSocket(folder / "st", "slave") as local:
            async with local.serving(answer):
                return await asyncio.to_thread(act)

    return asyncio.run(main()), asked


def stop(*words: str, before: str = "", path: Path | None = None, to: str = "") -> Done:
    """The command in a process of its own; `before`: what the shell does in it first; `to`: its stdout."""
    line = f'{before} exec "$0" -m forefeel estop "$@"' + (f" > {to}" if to else "")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, filter(None, [path, ROOT])))}
    return subprocess.run(
        ["sh", "-c", line, sys.executable, *words],
        env=environment, capture_output=True, text=True, timeout=50, check=False,
    )  # fmt: skip


def test_a_stop_beside_the_daemon_needs_no_package_that_may_be_broken(folder: Path) -> None:
    broken = folder / "broken"
    broken.mkdir()
    for name in HEAVY:
        (broken / f"{name}.py").write_text("raise ImportError('broken')\n")
    done, asked = beside_a_daemon(
        folder, lambda: stop("--config", "slave.yaml", "--reason", "--kinks", path=broken)
    )
    assert (done.returncode, done.stderr, asked) == (0, "", [Request("estop", "--kinks")])
    said, stopped = done.stdout.splitlines()
    assert said == "slave: axis insertion: estopped, pressed" and stopped.startswith("stopped in ")
    helped = stop("--help", path=broken)
    assert (helped.returncode, helped.stderr) == (0, "") and "Stop a cell" in helped.stdout


def test_the_time_that_it_says_is_that_of_the_process(folder: Path) -> None:
    start_s = time.monotonic()
    done, _ = beside_a_daemon(folder, lambda: stop("--config", "slave.yaml", before="sleep 0.3;"))
    whole_ms = (time.monotonic() - start_s) * 1e3
    found = re.search(r"^stopped in (\d+) ms", done.stdout, re.MULTILINE)
    assert found is not None
    assert 300 <= int(found[1]) <= whole_ms + 10.5  # a tick of the kernel, and rounding


def test_a_full_disk_takes_the_words_and_not_the_stop(folder: Path) -> None:
    done, asked = beside_a_daemon(folder, lambda: stop("--config", "slave.yaml", to="/dev/full"))
    assert (done.returncode, len(asked)) == (0, 1)
    assert "axis insertion: estopped" in done.stderr and "Traceback" not in done.stderr


def test_a_file_that_is_wrong_elsewhere_stops_where_the_daemon_runs_and_is_refused_elsewhere(
    folder: Path,
) -> None:
    (folder / "slave.yaml").write_text(f"{SLAVE}axes: [{{name: insertion, gate: {{watchdog_s: soon}}}}]\n")
    done, asked = beside_a_daemon(folder, lambda: stop("--config", "slave.yaml"))
    assert (done.returncode, len(asked)) == (0, 1)
    done = stop("--config", "slave.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1 and "slave.yaml:4: " in done.stderr


def test_a_daemon_that_can_not_stop_is_said_and_the_network_is_tried(
    folder: Path, monkeypatch: pytest.MonkeyPatch, run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("forefeel.local.stop.FOR_S", 0.1)

    def act() -> Done:
        return subprocess.CompletedProcess([], run(["estop", "--config", "slave.yaml"]))

    done, asked = beside_a_daemon(folder, act, done=False)
    why, failed = capsys.readouterr().err.splitlines()
    assert (done.returncode, len(asked)) == (1, 1)
    assert why == "slave: axis insertion: estopped, pressed; over the network, then"
    assert "EMERGENCY STOP NOT CONFIRMED by cell cell at tcp/127.0.0.1:1 in " in failed


def test_a_daemon_that_hangs_keeps_the_network_waiting_for_a_while_only(
    folder: Path, monkeypatch: pytest.MonkeyPatch, run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("forefeel.local.stop.FOR_S", 0.1)
    monkeypatch.setattr("forefeel.local.estop._PATIENCE_S", 0.1)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as hanging:
        hanging.bind(f"st/{SOCKET}")
        assert run(["estop", "--config", "slave.yaml"]) == 1
    assert capsys.readouterr().err.startswith(
        f"{folder / 'st' / SOCKET}: no daemon answers; over the network"
    )


@pytest.mark.parametrize(
    "words",
    [
        ["--config", "none.yaml"],
        ["--config", "slave.yaml", "--connect", "tcp/127.0.0.1:1"],
        ["--config", "slave.yaml", "--pki", "pki"],
        ["--config"],
        ["--nothing"],
        ["slave.yaml"],
    ],
)
def test_wrong_usage_is_one_line_and_stops_nothing(folder: Path, words: list[str]) -> None:
    done, asked = beside_a_daemon(folder, lambda: stop(*words))
    assert (done.returncode, done.stdout, asked) == (2, "", [])
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "text",
    [
        "role: slave",
        "role: master\ncell: lab",
        "{role: slave, cell: 'a.b'}",
        "role: slave\nstate:\n  directory: ../st",
        "role: slave\nstate: {directory: /var/lib/x}",
        "role: slave\nstate: {directory: }",
        "role: slave\nstate: {flight_records: 5}\ncell: 'é'",
    ],
)
def test_the_folder_is_that_of_the_daemon(folder: Path, text: str) -> None:
    path = folder / "some.yaml"
    path.write_text(text)
    settings = load_any(path)
    assert isinstance(settings, DaemonSettings)
    role = settings.model_dump(include={"role"})["role"]
    assert estop.state_folder(path) == state_path(settings, role, os.environ)


@pytest.mark.parametrize(
    "text", ["role: viewer", "role: 5", "cell: a", "role: slave\nstate: 5", "role: slave\ncell: 5"]
)
def test_a_file_of_no_daemon_has_no_folder(folder: Path, text: str) -> None:
    path = folder / "some.yaml"
    path.write_text(text)
    assert estop.state_folder(path) is None


def test_typer_has_every_option_of_the_parser() -> None:
    known = {each.get_opt_string(): each.help for each in estop.PARSER.option_list}
    shown = {each.opts[0]: each.help for each in group(["estop"]).params}
    assert {**known, "--help": ""} == {**shown, "--help": ""}
