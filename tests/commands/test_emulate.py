"""`forefeel emulate` on the command line: bad input in one line, a device that appears and goes."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import yaml

Run = Callable[[Sequence[str]], int]
SLAVE = {
    "role": "slave",
    "axes": [
        {
            "limits": {"workspace_m": [0.0, 0.1], "max_force_n": 3.0},
            "stage": {
                "driver": "zaber_ascii", "port": "PORT", "microstep_m": 1e-7, "travel_m": [-0.001, 0.101],
            },
        }
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("warp --port {0}/p", "'warp': expected one of ascii_line, bota_serial"),
        ("zaber_ascii", "expected --port LINK, or --config FILE that has it"),
        ("can_hub", "emulate can_hub: expected --port LINK,LINK"),
        (
            "bota_serial --port {0}/p --faults drop=2",
            "--faults 'drop=2': expected drop, corrupt, split, delay",
        ),
        ("bota_serial --port {0}/taken", "exists and is no link; expected a free path"),
        ("bota_serial --config {0}/slave.yaml", "axis insertion has no driver 'bota_serial'"),
        ("zaber_ascii --config {0}/slave.yaml --axis wrist", "--axis wrist: expected one of insertion"),
        ("zaber_ascii --config {0}/none.yaml", "none.yaml: No such file or directory"),
        ("zaber_ascii --port {0}/p --feel {0}/" + "long" * 40, "too long for a socket"),
        ("cia402 --port {0}/nothing", "nothing"),
    ],
)
def test_what_can_not_be_emulated_is_one_line(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, words: str, message: str
) -> None:
    (tmp_path / "taken").write_text("mine")
    (tmp_path / "slave.yaml").write_text(yaml.safe_dump(SLAVE))
    assert run(["emulate", *words.format(tmp_path).split()]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1
    assert (tmp_path / "taken").read_text() == "mine"


def test_a_device_appears_where_it_was_told_and_says_what_befell_its_bytes(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    link = tmp_path / "cell"
    assert run(["emulate", "bota_serial", "--port", str(link), "--duration", "0.2"]) == 0
    first, *_, last = capsys.readouterr().out.splitlines()
    assert first == f"bota_serial on {link} at 460800 baud"
    assert json.loads(last)["to_host"]["chunks"] > 50
    assert not link.is_symlink()


def test_a_device_is_that_of_the_file(run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "slave.yaml"
    file.write_text(yaml.safe_dump(SLAVE).replace("PORT", str(tmp_path / "stage")))
    assert run(["emulate", "zaber_ascii", "--config", str(file), "--duration", "0.05"]) == 0
    assert f"zaber_ascii on {tmp_path / 'stage'} at 115200 baud" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--hardware real", "--hardware 'real': expected one of simulated, emulated-serial, emulated-can"),
        ("--hardware emulated-can --virtual-time", "expected no --virtual-time"),
        ("--hardware emulated-serial --recording x.csv", "expected no --recording"),
    ],
)
def test_a_loopback_on_hardware_that_can_not_be(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, words: str, message: str
) -> None:
    assert run(["loopback", *words.split(), "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
