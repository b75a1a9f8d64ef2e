"""What a late machine excuses, and that it excuses nothing else."""

import threading
import time
from pathlib import Path

import pytest

from forefeel.common.messages import SafetyEvent
from tests.unit.recording_samples import header
from tests.witness import Witness, check_stops

pytest_plugins = ["pytester"]
LATE_S = 0.2


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Once it is set, a thread that sleeps is woken late, as by a machine that stood still."""
    found, sleep = threading.Event(), time.sleep
    monkeypatch.setattr("tests.witness.time.sleep", lambda s: sleep(s + (LATE_S if found.is_set() else 0.0)))
    return found


def fail(error: Exception) -> None:
    raise error


def test_what_came_too_late_is_not_judged_while_the_machine_was_late(slow: threading.Event) -> None:
    slow.set()
    with Witness() as witness:
        while witness.late_s < 0.1:
            pass
        with witness.timely(0.1):
            fail(AssertionError("took 0.3 s\nand more"))
        with witness.timely(0.1):
            pass
    assert len(witness.not_judged) == 1
    assert witness.not_judged[0].endswith("ms: took 0.3 s")


def test_the_machine_s_lateness_excuses_no_more_than_twice_itself(slow: threading.Event) -> None:
    slow.set()
    with Witness() as witness:
        while witness.late_s < 0.1:
            pass
        with pytest.raises(AssertionError, match="took long"), witness.timely(100.0):
            fail(AssertionError("took long"))
        with pytest.raises(ValueError, match="broken"), witness.timely(0.1):
            fail(ValueError("broken"))
    assert witness.not_judged == []


def test_a_thread_that_still_waits_to_be_woken_counts() -> None:
    witness = Witness()  # not even started
    end_s = time.monotonic() + LATE_S
    while time.monotonic() < end_s:
        pass
    assert witness.late_s >= LATE_S


SUITE = """
import pytest

@pytest.fixture
def late(witness, monkeypatch):
    monkeypatch.setattr(type(witness), "late_s", 1.0)

@pytest.mark.parametrize("number", range(20))
def test_on_time(witness, number):
    with witness.timely(0.1):
        assert number < 20

@pytest.mark.parametrize("number", range({late}))
def test_late(late, witness, number):
    with witness.timely(0.1):
        assert number == -1

def test_unasked(witness):
    pass
"""


@pytest.mark.parametrize("workers", [0, 2])
@pytest.mark.parametrize(("late", "code", "failed"), [(1, 0, ""), (2, 1, "FAILED ")])
def test_the_run_says_what_was_not_judged_and_fails_when_it_is_much(
    pytester: pytest.Pytester,
    monkeypatch: pytest.MonkeyPatch,
    late: int,
    code: int,
    failed: str,
    workers: int,
) -> None:
    pytester.makeini("[pytest]\nasyncio_default_fixture_loop_scope = function\n")
    pytester.makepyfile(test_it=SUITE.format(late=late))
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    ended = pytester.runpytest_subprocess("-p", "tests.witness", "-p", "no:cacheprovider", "-n", str(workers))
    assert ended.ret == code
    ended.stdout.fnmatch_lines(
        [
            f"{failed}timeliness: judged in 20 of {20 + late} tests; at most one or 5% may go without",
            "NOT JUDGED test_it.py::test_late[[]0[]]: the machine was late by 1000 ms: assert 0 == -1",
        ]
    )


def event(before: str, name: str, after: str, reason: str = "why", sequence: int = 2) -> SafetyEvent:
    return SafetyEvent.model_validate(
        {**header(sequence), "before": before, "event": name, "after": after, "reason": reason}
    )


STOP = event("armed", "watchdog", "stopping", sequence=1)
REST = event("stopping", "at_rest", "ready")
AGAIN = event("engaging", "engaged", "armed", sequence=4)


@pytest.mark.parametrize(
    "events", [[], [STOP], [STOP, REST], [STOP, event("stopping", "estop", "estopped")], [STOP, AGAIN]]
)
def test_an_orderly_stop_says_why_and_ends_at_rest(events: list[SafetyEvent]) -> None:
    check_stops(events)


@pytest.mark.parametrize(
    "events",
    [
        [event("armed", "watchdog", "stopping", ""), REST],
        [STOP, event("stopping", "engaged", "armed")],
        [event("armed", "session_lost", "idle")],
    ],
)
def test_a_disorderly_stop_is_found(events: list[SafetyEvent]) -> None:
    with pytest.raises(AssertionError):
        check_stops(events)
