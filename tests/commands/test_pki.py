"""`forefeel pki`, and what the daemons say about certificates, as a person meets them."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from tests.secured import expired_pki, make_pki

Run = Callable[[Sequence[str]], int]
STAGE = "{driver: zaber_ascii, port: /dev/none, microstep_m: 1.0e-7, travel_m: [-0.01, 0.2]}"
REAL_STAGE = f"axes: [{{stage: {STAGE}}}]\n"


def test_a_laboratory_from_init_to_renewal(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pki = tmp_path / "pki"
    hosts = ["--hosts", "slave=10.0.0.1,slave-host", "--hosts", "router=10.0.0.5"]
    assert run(["pki", "init", str(pki), "--cell", "a", "--cell", "b", *hosts, "--days", "20"]) == 0
    said = capsys.readouterr().out
    assert "  b/master: b/ca.crt b/master.crt b/master.key\n" in said
    assert f"keep {pki}/ca.key off the hosts" in said
    assert run(["pki", "show", str(pki), "--json"]) == 0
    found = {row["file"]: row for row in json.loads(capsys.readouterr().out)}
    assert found["a/slave.crt"]["hosts"] == ["10.0.0.1", "slave-host"]
    assert {row["colour"] for name, row in found.items() if name != "ca.crt"} == {"amber"}
    assert run(["pki", "renew", str(pki), "a/slave", "--days", "90"]) == 0
    assert run(["pki", "add", str(pki), "--cell", "c"]) == 0
    assert run(["pki", "bundle", str(pki), "c/slave", "--out", str(tmp_path / "hand" / "pki")]) == 0
    capsys.readouterr()
    assert run(["pki", "show", str(pki)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("| green | a/slave.crt") and "10.0.0.1 slave-host" in line for line in lines)
    assert any(line.startswith("| amber | b/slave.crt") for line in lines)
    assert run(["pki", "show", str(tmp_path / "hand" / "pki")]) == 0
    assert run(["pki", "rules", "--cell", "a", "--cell", "b", "--out", str(tmp_path / "zenoh")]) == 0
    assert len(list((tmp_path / "zenoh").iterdir())) == 9


def test_a_red_certificate_is_exit_1(run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run(["pki", "show", str(expired_pki(tmp_path / "pki"))]) == 1
    assert "red: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("pki init @/pki", "--cell"),
        ("pki init @/pki --cell a/b", "expected 1 to 46 letters"),
        ("pki init @/pki --cell a --hosts boss=h", "'boss' is nobody here"),
        ("pki init @/full --cell a", "is there already; expected a new folder"),
        ("pki init @/file/pki --cell a", "file"),
        ("pki add @/none --cell a", "ca.key: No such file"),
        ("pki show @/none", "no certificates; expected a folder of forefeel pki init"),
        ("pki renew @/full boss", "expected one of master, recorder, slave, viewer, router"),
        ("pki bundle @/full boss --out @/x", "'boss' is nobody here"),
        ("router --cell a", "transport.listen: expected at least one endpoint"),
        ("router --listen tls/127.0.0.1:7447", "--cell: missing"),
        ("router --listen tcp/0.0.0.0:7447 --cell a", "outside this host without certificates"),
        ("router --listen tls/0.0.0.0:7447 --pki @/none --cell a", "none: no such folder; expected what"),
        ("router --listen tcp/0.0.0.0:7447 --pki @/full --cell cell", "a plain listener beside certificates"),
        ("router --config @/router.yaml --cell a", "expected it alone"),
        ("record --out @/run.mcap", "--connect: missing"),
        ("record --out @/run.mcap --connect tcp/10.0.0.1:1", "outside this host without certificates"),
        ("record --out @/run.mcap --connect tls/10.0.0.1:1 --pki @/none", "none: no such folder"),
        ("record --out @/run.mcap --connect tls/10.1:1 --pki @/full --cell other", "made for forefeel-cell"),
        ("record --out @/run.mcap --config @/r.yaml --cell a", "expected it alone"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line_and_nothing_is_written(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: str, words: str
) -> None:
    make_pki(tmp_path / "full")
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    assert run(arguments.replace("@", str(tmp_path)).split()) in ({1, 2} if "@/file" in arguments else {2})
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("command", "transport", "more", "words"),
    [
        (
            "slave",
            "['tls/0.0.0.0:7447'], pki: pki",
            "",
            "pki: no such folder; expected what forefeel pki init",
        ),
        ("master", "['tls/0.0.0.0:7447'], pki: pki", "", "pki: no such folder; expected what forefeel pki"),
        ("slave", "['tls/0.0.0.0:7447'], pki: expired", "", "expired/slave.crt: expired on "),
        ("slave", "['tcp/0.0.0.0:7447']", "", "outside this host without certificates"),
        ("slave", "['tls/0.0.0.0:7447']", "", "outside this host without certificates"),
        ("slave --insecure", "['tcp/[::]:7447']", REAL_STAGE, "a real stage and no certificates"),
        ("slave --insecure", "['tcp/127.0.0.1:1234'], pki: good", "", "a plain listener beside certificates"),
        ("slave", "['tls/127.0.0.1:1#enable_mtls=false'], pki: good", "", "'enable_mtls' after #"),
    ],
)
def test_a_daemon_without_security_does_not_start(
    run: Run,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    command: str,
    transport: str,
    more: str,
    words: str,
) -> None:
    make_pki(tmp_path / "good")
    expired_pki(tmp_path / "expired")
    role, *flag = command.split()
    (tmp_path / "file.yaml").write_text(f"role: {role}\ntransport: {{listen: {transport}}}\n{more}")
    assert run([role, "--config", str(tmp_path / "file.yaml"), *flag]) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") == 1
