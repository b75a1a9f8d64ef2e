"""A stop waits for no other program where that is permitted."""

import os
import sys

import pytest

from forefeel.__main__ import main


@pytest.mark.parametrize(("command", "expected"), [("estop", [(os.SCHED_FIFO, 25)]), ("clear", [])])
def test_a_stop_goes_first_and_nothing_else(
    monkeypatch: pytest.MonkeyPatch, command: str, expected: list[tuple[int, int]]
) -> None:
    asked: list[tuple[int, int]] = []

    def noted(_process: int, policy: int, parameter: os.sched_param) -> None:
        asked.append((policy, parameter.sched_priority))

    monkeypatch.setattr("os.sched_setscheduler", noted)
    monkeypatch.setattr(sys, "argv", ["forefeel", command, "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    assert asked == expected


def test_where_it_is_not_permitted_it_stops_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr("os.sched_setscheduler", refused)
    monkeypatch.setattr(sys, "argv", ["forefeel", "estop", "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    assert "Stop a cell" in capsys.readouterr().out
