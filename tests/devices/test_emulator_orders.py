"""What is said to an emulated device while it runs."""

import os
import sys
from collections.abc import Iterator

import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.devices.emulation.bench import Load
from forefeel.emulate.run import OrderReader, OrdersFromStdin


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, Load, list[str], OrdersFromStdin]]:
    """The end that is written to, and what comes of it."""
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        load, faults = Load(), list[str]()
        yield (
            writing,
            load,
            faults,
            OrdersFromStdin(OrderReader(("unplug", "plug", "stuck"), faults.append, load)),
        )


def test_lines_are_obeyed_in_order_however_they_are_cut_and_the_last_needs_no_end(
    told: tuple[int, Load, list[str], OrdersFromStdin],
) -> None:
    writing, load, faults, orders = told
    seen = []
    for part in (b"load 1", b".5\nunp", b"lug\n\nload -2\nplug\nstu", b"ck"):
        os.write(writing, part)
        orders.step()
        seen.append(load.force_n)
    assert seen == [0.0, 1.5, -2.0, -2.0]
    os.close(writing)
    for _ in range(3):
        orders.step()
    assert faults == ["unplug", "plug", "stuck"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("warp", "'warp': expected load N, unplug, plug, stuck"),
        ("load", "'load': expected load N, unplug, plug, stuck"),
        ("load 1 2", "'load 1 2': expected load N, "),
        ("load nan", "'load nan': expected a force in N, such as load 1.5"),
        ("load 1e9", "'load 1e9': expected a force in N"),
        ("unplug now", "'unplug now': expected "),
        ("x" * 300, f"{'x' * 40!r}: expected "),
        ("\xff\x00", "expected load N"),
    ],
)
def test_a_wrong_line_is_answered_in_one_line_and_changes_nothing(
    told: tuple[int, Load, list[str], OrdersFromStdin],
    capsys: pytest.CaptureFixture[str],
    line: str,
    message: str,
) -> None:
    writing, load, faults, orders = told
    os.write(writing, line.encode("latin-1") + b"\n")
    os.close(writing)
    orders.step()
    (said,) = capsys.readouterr().err.splitlines()
    assert message in said
    assert (load.force_n, faults) == (0.0, [])


def test_a_stage_has_no_load_and_a_closed_stdin_is_fine(monkeypatch: pytest.MonkeyPatch) -> None:
    orders = OrderReader(("unplug",), lambda _: None, None)
    with pytest.raises(ConfigurationError, match="'load 1': expected unplug"):
        orders.obey("load 1")
    monkeypatch.setattr(sys, "stdin", None)
    OrdersFromStdin(orders).step()
