"""What is said to an emulated device while it runs."""

import sys
from pathlib import Path

import pytest

from forefeel.common.errors import ConfigurationError
from forefeel.devices.emulation.bench import Load
from forefeel.emulate.run import obey, obey_stdin


class Device:
    faults = ("unplug", "plug")

    def __init__(self) -> None:
        self.provoked: list[str] = []

    def step(self) -> None: ...

    def provoke(self, fault: str) -> None:
        self.provoked.append(fault)


def test_orders_on_stdin_are_obeyed_past_wrong_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    device, load = Device(), Load()
    (tmp_path / "orders").write_text("load 1.5\nunplug\n\nwarp\nplug")
    with (tmp_path / "orders").open() as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        for _ in range(3):
            obey_stdin(device, load)
    assert (load.force_n, device.provoked) == (1.5, ["unplug", "plug"])
    assert len(capsys.readouterr().err.splitlines()) == 1
    monkeypatch.setattr(sys, "stdin", None)
    obey_stdin(device, load)


@pytest.mark.parametrize("line", ["warp", "load", "load 1 2", "load nan", "load 1e9", "unplug now"])
def test_wrong_order_is_refused_and_changes_nothing(line: str) -> None:
    device, load = Device(), Load()
    with pytest.raises(ConfigurationError, match="load N, unplug, plug"):
        obey(line, device, load)
    assert (load.force_n, device.provoked) == (0.0, [])


def test_stage_has_no_load() -> None:
    with pytest.raises(ConfigurationError, match="expected unplug"):
        obey("load 1", Device(), None)
