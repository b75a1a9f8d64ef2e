"""One line for whatever is wrong, exit code 2, and nothing left behind."""

import socket
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from forefeel.common.recording.mcap_writer import RunWriter
from tests.commands.bad_lines import BAD, Bad
from tests.commands.command_line import contents
from tests.unit.recording_samples import force, put


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
def test_bad_input_is_one_line_and_leaves_nothing_behind(
    bad: Bad, run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for name, text in bad.files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        if text == "@an empty run":
            with RunWriter(tmp_path / name) as writer:
                put(writer, force(1))
        else:
            (tmp_path / name).write_text(text)
    before = contents(tmp_path)
    assert run(bad.arguments.replace("@", str(tmp_path)).split()) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("forefeel: ")
    assert shown.err.count("\n") == 1
    assert shown.err.endswith("\n")
    for word in bad.words:
        assert word in shown.err
    assert contents(tmp_path) == before


def test_an_endpoint_that_is_taken_is_named(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        (tmp_path / "file.yaml").write_text(f"role: slave\ntransport: {{listen: ['{endpoint}']}}\n")
        assert run(["slave", "--config", str(tmp_path / "file.yaml")]) == 2
    assert capsys.readouterr().err == (
        f"forefeel: endpoint '{endpoint}': taken by another program; end that one or listen on another port\n"
    )


def test_a_slave_that_does_not_answer_is_waited_for_as_long_as_was_said(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        endpoint = f"tcp/127.0.0.1:{silent.getsockname()[1]}"
    text = f"role: master\npeer_timeout_s: 0.3\ntransport: {{connect: ['{endpoint}']}}\n"
    (tmp_path / "file.yaml").write_text(text)
    assert run(["master", "--config", str(tmp_path / "file.yaml")]) == 2
    *progress, last = capsys.readouterr().err.splitlines()
    assert all(line.startswith("master: ") for line in progress)
    assert last == (
        "forefeel: no session with a slave within 0.3 s (peer_timeout_s): "
        f"{endpoint.removeprefix('tcp/')} refuses the connection: start the slave there (0.3 s)"
    )


def test_an_mcap_of_two_axes_is_no_recording_to_play(
    run: Callable[[Sequence[str]], int], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with RunWriter(tmp_path / "two.mcap") as writer:
        for name in ("insertion", "rotation"):
            for index in range(3):
                put(writer, force(index), axis=name)
    line = f"loopback --virtual-time --out {tmp_path}/out --recording {tmp_path}/two.mcap"
    assert run(line.split()) == 2
    assert "holds insertion, rotation, expected one axis" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
