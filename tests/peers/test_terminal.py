"""Terminals and a shell that we did not write."""

import os
import pty
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.live_cell import IMPORTS


def in_a_process(words: list[str], stdout: int, stderr: int, **variables: str) -> int:
    environment = {"TERM": "xterm-256color", "COLUMNS": "120", "PYTHONPATH": IMPORTS, **variables}
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    command = [sys.executable, "-m", "forefeel", *words]
    return subprocess.run(
        command, stdout=stdout, stderr=stderr, env={**kept, **environment}, timeout=50, check=False
    ).returncode


def on_a_terminal(words: list[str], **variables: str) -> tuple[int, str, str]:
    """Exit code, what a terminal on stderr gets, what a pipe on stdout gets."""
    ours, theirs = pty.openpty()
    read, write = os.pipe()
    seen: list[bytes] = []

    def drain() -> None:
        try:
            while data := os.read(ours, 65536):
                seen.append(data)
        except OSError:  # the other end is closed
            return

    thread = threading.Thread(target=drain)
    thread.start()
    try:
        code = in_a_process(words, write, theirs, **variables)
    finally:
        os.close(theirs)
        os.close(write)
        thread.join()
        os.close(ours)
    with os.fdopen(read) as out:
        return code, b"".join(seen).decode(), out.read()


@pytest.fixture
def simulation(tmp_path: Path) -> list[str]:
    model = "schema: forefeel.model/1\nname: x\neffects:\n  - effect: mass_damper_spring\n"
    (tmp_path / "model.yaml").write_text(model)
    return f"simulate --model {tmp_path}/model.yaml --out {tmp_path}/run.csv --overwrite".split()


def test_a_bar_is_for_a_terminal_and_the_answer_for_a_pipe(simulation: list[str]) -> None:
    code, bar, answer = on_a_terminal(simulation)
    assert code == 0
    assert "simulating" in bar
    assert "\x1b[" in bar
    assert answer.endswith("seed 0\n")
    assert "\x1b" not in answer
    assert answer.count("\n") == 1
    code, bar, answer = on_a_terminal([*simulation, "--quiet"])
    assert (code, bar, answer) == (0, "", "")


def test_bash_itself_completes_with_the_script_that_is_installed(tmp_path: Path) -> None:
    command = tmp_path / "forefeel"
    command.write_text(f'#!/bin/sh\nPYTHONPATH={IMPORTS} exec {sys.executable} -m forefeel "$@"\n')
    command.chmod(0o755)
    script = f"""PATH={tmp_path}:$PATH
    eval "$(forefeel --show-completion)"
    COMP_WORDS=(forefeel report --js) COMP_CWORD=2
    _forefeel_completion forefeel
    echo "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=50, check=True)
    assert (done.stdout, done.stderr) == ("--json\n", "")
