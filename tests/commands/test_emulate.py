"""`forefeel emulate` on the command line: bad input in one line, a device that appears and goes."""

import pytest
import yaml

from tests.commands.conftest import Shell

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
def test_what_can_not_be_emulated_is_one_line(shell: Shell, line: str, words: tuple[str, ...]) -> None:
    shell.refused(line, words, {"taken": "mine", "slave.yaml": yaml.safe_dump(SLAVE)})


def test_a_device_appears_where_it_was_told_and_goes(shell: Shell) -> None:
    link = shell.folder / "cell"
    shown = shell(f"emulate bota_serial --port {link} --duration 0.2")
    assert (shown.code, shown.out) == (0, f"bota_serial on {link} at 460800 baud\n")
    assert not link.is_symlink()


def test_a_device_is_that_of_the_file(shell: Shell) -> None:
    shell.write({"slave.yaml": yaml.safe_dump(SLAVE).replace("PORT", str(shell.folder / "stage"))})
    shown = shell("emulate zaber_ascii --config slave.yaml --duration 0.05")
    assert shown.code == 0
    assert f"zaber_ascii on {shell.folder / 'stage'} at 115200 baud" in shown.out
