"""`forefeel emulate` on the command line: bad input in one line, a device that appears and goes."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import yaml

from tests.commands.command_line import refused

Run = Callable[[Sequence[str]], int]
SLAVE = {
    "role": "slave",
    "axes": [
        {
            "limits": {"workspace_m": [0.0, 0.1], "max_force_n": 3.0},
            "stage": {
                "driver": "zaber_ascii", "port": "PORT", "microstep_m": 1e-7, "travel_m": [-0.001, 0.101],
            },
            "load_cell": {"driver": "simulated"},
            "gripper": {"driver": "simulated"},
        }
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("emulate warp --port @/p", ("'warp'", "bota_serial")),
        ("emulate zaber_ascii", ("--port LINK",)),
        ("emulate can_hub", ("--port LINK,LINK",)),
        ("emulate bota_serial --port @/taken", ("exists and is no link",)),
        ("emulate bota_serial --port @/none/port", ("No such file", "expected a folder")),
        ("emulate bota_serial --config @/slave.yaml", ("insertion", "'bota_serial'")),
        ("emulate zaber_ascii --config @/slave.yaml --axis wrist", ("--axis wrist", "insertion")),
        ("emulate zaber_ascii --config @/none.yaml", ("none.yaml", "No such file")),
        ("emulate zaber_ascii --port @/p --feel @/" + "long" * 40, ("too long",)),
        ("emulate cia402 --port @/nothing", ("nothing",)),
        ("loopback --out @/out --hardware real", ("--hardware 'real'", "emulated-serial")),
        ("loopback --out @/out --hardware emulated-can --virtual-time", ("--virtual-time",)),
        ("loopback --out @/out --rate 50", ("--rate", "--recording")),
        ("loopback --out @/out --hardware emulated-serial --recording x.csv", ("--recording",)),
    ],
)
def test_what_can_not_be_emulated_is_one_line(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, line: str, words: tuple[str, ...]
) -> None:
    files = {"taken": "mine", "slave.yaml": yaml.safe_dump(SLAVE)}
    refused(run, capsys, tmp_path, line, words, files)


def test_a_device_appears_where_it_was_told_and_says_what_befell_its_bytes(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    link = tmp_path / "cell"
    assert run(["emulate", "bota_serial", "--port", str(link), "--duration", "0.2"]) == 0
    assert capsys.readouterr().out == f"bota_serial on {link} at 460800 baud\n"
    assert not link.is_symlink()


def test_a_device_is_that_of_the_file(run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "slave.yaml"
    file.write_text(yaml.safe_dump(SLAVE).replace("PORT", str(tmp_path / "stage")))
    assert run(["emulate", "zaber_ascii", "--config", str(file), "--duration", "0.05"]) == 0
    assert f"zaber_ascii on {tmp_path / 'stage'} at 115200 baud" in capsys.readouterr().out
