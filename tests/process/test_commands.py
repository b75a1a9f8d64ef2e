"""Commands as the operating system meets them: Ctrl-C, missing packages, the service manager."""

import signal
import socket
from pathlib import Path

from tests.live_cell import LiveCell, Process, free_port
from tests.unit.diagnosis_samples import FRICTION_N, made, put
from tests.waiting import PATIENCE_S, wait_until


def test_interrupted_diagnosis_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for name in "ab":
        put(tmp_path / "in" / f"{name}.csv", made(60.0, friction_n=FRICTION_N, bias_n=0.05))
    diagnosis = Process("diagnose", tmp_path, *["diagnose", "in", "--jobs", "2", "--out", "new/out"])
    try:
        wait_until((tmp_path / "new" / "out").exists)
        diagnosis.interrupt()
        assert diagnosis.wait() == 1, diagnosis.text
        assert "interrupted" in diagnosis.text.splitlines()[-1]
        assert "Traceback" not in diagnosis.text
        assert not (tmp_path / "new").exists()
        wait_until(lambda: not diagnosis.group_runs(), what="the end of the workers")
    finally:
        diagnosis.kill()


def test_estop_needs_no_package_but_yaml(tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    for name in ("typer", "pydantic", "zenoh", "numpy", "rich"):
        (broken / f"{name}.py").write_text(f"raise ImportError('{name} is broken')\n")
    with LiveCell(tmp_path) as cell:
        cell.pair()
        words = "estop", "estop", "--config", "slave.yaml"
        stop = Process(words[0], tmp_path, *words[1:], ahead=broken)
        assert stop.wait() == 0, stop.text
        cell.await_state("estopped")


def test_slave_tells_systemd_readiness_life_and_end(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    (tmp_path / "slave.yaml").write_text(f"role: slave\ntransport: {{listen: ['{endpoint}']}}\n")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        told = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "400000"}
        slave = Process("slave", tmp_path, "slave", "--config", "slave.yaml", environment=told)
        try:
            heard = [systemd.recv(4096).decode()]
            while "WATCHDOG=1" not in heard:
                heard.append(systemd.recv(4096).decode())
            assert heard.count("READY=1") == 1
            slave.send(signal.SIGTERM)
            while not systemd.recv(4096).startswith(b"STOPPING=1"):
                pass
            assert slave.wait() == 0
        finally:
            slave.kill()
