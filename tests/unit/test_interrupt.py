"""What a signal does to a process that is at work."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

SELF = """
import os, signal
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # which a test run under nohup ignores
tell = lambda number: os.kill(os.getpid(), number)
"""


def ended(script: str, *words: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a script in a process of its own; `tell` sends it a signal."""
    done = subprocess.run(
        [sys.executable, "-c", SELF + textwrap.dedent(script), *words],
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_in_a_callback_that_swallows_what_is_raised_ends_the_process(number: str) -> None:
    script = f"""
        import ctypes
        from forefeel.interrupt import ends_in_order
        with ends_in_order("work"):
            ctypes.CFUNCTYPE(None)(lambda: tell(signal.{number}))()
            print("went on")
    """
    assert ended(script) == (1, "", "forefeel: work interrupted; nothing was written\n")


def test_what_is_half_written_goes_with_the_folder_that_was_made_for_it(tmp_path: Path) -> None:
    script = """
        import sys
        from pathlib import Path
        from forefeel.files import whole
        from forefeel.interrupt import ends_in_order
        file = Path(sys.argv[1]) / "new" / "out" / "a.txt"
        with ends_in_order("work", file.parent), whole(file, "the work") as part:
            part.write_text("half")
            tell(signal.SIGHUP)
            print("went on")
    """
    assert ended(script, str(tmp_path)) == (1, "", "forefeel: work interrupted; nothing was written\n")
    assert list(tmp_path.iterdir()) == []


def test_a_body_that_heeds_signals_looks_and_ends_by_itself() -> None:
    script = """
        from forefeel.interrupt import heeded
        with heeded() as stop:
            assert not stop.wanted()
            tell(signal.SIGHUP)
            tell(signal.SIGHUP)  # a terminal that closes sends two
            assert stop.wanted() and not stop.again()
        print("in order")
    """
    assert ended(script) == (0, "in order\n", "")


def test_a_body_that_did_not_look_is_done_first() -> None:
    script = """
        from forefeel.interrupt import ends_in_order, heeded
        with ends_in_order("work") as written:
            with heeded():
                tell(signal.SIGTERM)
                written.append("both files")
            print("went on")
    """
    assert ended(script) == (1, "", "forefeel: work interrupted; both files\n")


@pytest.mark.parametrize(
    ("tell_it", "code"), [("", 1), ("lambda: print('told', flush=True)", 0)], ids=["at once", "never cut"]
)
def test_a_second_signal_ends_a_body_that_does_not_look(tell_it: str, code: int) -> None:
    script = f"""
        import time
        from forefeel.interrupt import heeded
        with heeded({tell_it}) as stop:
            tell(signal.SIGINT)
            while not stop.again():
                time.sleep(0.1)
                tell(signal.SIGTERM)
    """
    found = ended(script)
    assert found[0] == code
    assert found[2] == ("forefeel: interrupted\n" if code else "")


def test_a_command_under_nohup_stays() -> None:
    script = """
        from forefeel.interrupt import heeded
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with heeded() as stop:
            tell(signal.SIGHUP)
            print(stop.wanted())
    """
    assert ended(script)[:2] == (0, "False\n")


@pytest.mark.parametrize("order", ["body", "before", "opening"])
def test_a_wait_for_a_person_breaks_off_in_one_line(order: str) -> None:
    """Also for a signal that comes before the wait, or while what it needs is opened."""
    script = f"""
        from contextlib import contextmanager
        from forefeel.common.errors import RunError
        from forefeel.interrupt import breakable, heeded

        def come(when):
            if when == {order!r}:
                tell(signal.SIGHUP)

        @contextmanager
        def device():
            come("opening")
            yield

        try:
            with heeded():
                come("before")
                with breakable(lambda: "broke off"), device():
                    come("body")
                    print("went on")
        except RunError as error:
            print(error)
    """
    assert ended(script) == (0, "broke off\n", "")


def test_python_shows_no_traceback_once_the_command_line_is_there() -> None:
    script = """
        import forefeel.__main__
        tell(signal.SIGINT)
    """
    assert ended(script) == (-signal.SIGINT, "", "")
