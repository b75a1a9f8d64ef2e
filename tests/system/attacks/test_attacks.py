"""The attack matrix as tests: some in virtual time here, all of it in the soak."""

import subprocess
import sys

import pytest

from tests.live_cell import ROOT
from tests.system.attacks.virtual import VIRTUAL

QUICK = (
    "commands replayed within the session",
    "a whole session replayed to a slave started again",
    "second writer, the session's id, numbered ahead",
    "heartbeats that echo what was never sent",
    "emergency stop sent again, also after a clearing",
    "malformed payloads",
    "control characters in texts",
    "wildcard as a name of a cell or axis",
)


@pytest.mark.parametrize("name", QUICK)
def test_an_attack_is_refused_and_counted(name: str) -> None:
    assert VIRTUAL[name](name).wrong == []


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_every_attack_is_refused_and_counted() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.system.attacks"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    print(done.stdout)
    assert done.returncode == 0
