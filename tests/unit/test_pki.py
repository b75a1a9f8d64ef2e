"""The authority and its folder: what is in the certificates, who may read the keys, what is refused."""

import ipaddress
import json
import shutil
import stat
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID

from forefeel.common.errors import ConfigurationError
from forefeel.common.transport.pki import read_identity
from forefeel.common.transport.security import CELL_ROLES, Party
from forefeel.pki.authority import Authority, certificate_pem, hosts_of, key_pem, new_key
from forefeel.pki.folder import certificate_rows, init_folder, router_file
from tests.secured import expired_pki, make_pki

Run = Callable[[Sequence[str]], int]
NOW = datetime(2026, 11, 20, 12, 0, tzinfo=UTC)
DAY = timedelta(days=1)
SLAVE = Party("slave", ("cell",))


@pytest.fixture
def pki(tmp_path: Path) -> Path:
    """All roles of one cell in one folder, valid for 90 days."""
    hosts = {"slave": ["10.0.0.1", "fe80::1", "slave-host.local"]}
    return make_pki(tmp_path / "pki", hosts=hosts, now=NOW, days=90)


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_folder_of_each_host_holds_its_files_and_no_more(tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    done = init_folder(lab, ["a", "b"], [], 90, NOW)
    assert set(done.values()) == {"new"}
    assert set(done) == {lab / cell / role for cell in "ab" for role in CELL_ROLES} | {lab / "router"}
    assert {path.name for path in lab.iterdir()} == {"ca.crt", "ca.key", "a", "b", "router"}
    for path in done:
        own = {"ca.crt", f"{path.name}.crt", f"{path.name}.key"}
        assert {each.name for each in path.iterdir()} - {"router.json5"} == own
        for each in path.iterdir():
            assert stat.S_IMODE(each.stat().st_mode) == (0o600 if each.suffix == ".key" else 0o644)
        assert stat.S_IMODE(path.stat().st_mode) == 0o700
    assert (lab / "router" / "router.json5").read_text() == router_file(["a", "b"])
    read_identity(lab / "router", Party("router", ("a", "b")), NOW)
    read_identity(lab / "b" / "slave", Party("slave", ("b",)), NOW)
    with pytest.raises(ConfigurationError, match="made for forefeel-a-slave"):
        read_identity(lab / "a" / "slave", Party("slave", ("b",)), NOW)


@pytest.mark.parametrize("role", [*CELL_ROLES, "router"])
def test_a_role_s_certificate(pki: Path, role: str) -> None:
    found, authority = certificate(pki / f"{role}.crt"), certificate(pki / "ca.crt")
    found.verify_directly_issued_by(authority)
    key = load_pem_private_key((pki / f"{role}.key").read_bytes(), None)
    assert key.public_key() == found.public_key()
    assert isinstance(key, ec.EllipticCurvePrivateKey)
    assert key.curve.name == "secp256r1"
    name = "forefeel-router" if role == "router" else f"forefeel-cell-{role}"
    assert [each.value for each in found.subject] == [name]
    for each, signs in ((found, False), (authority, True)):
        read = each.extensions.get_extension_for_class
        assert (read(x509.BasicConstraints).value.ca, read(x509.BasicConstraints).critical) == (signs, True)
        assert read(x509.KeyUsage).value.key_cert_sign is signs
    both = {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}
    assert set(found.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value) == both
    assert found.not_valid_before_utc == NOW - timedelta(hours=1)
    assert found.not_valid_after_utc == NOW + 90 * DAY


def test_the_hosts_are_names_and_addresses(pki: Path) -> None:
    names = (
        certificate(pki / "slave.crt").extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    )
    assert names.get_values_for_type(x509.DNSName) == ["slave-host.local", "localhost"]
    addresses = ["10.0.0.1", "fe80::1", "127.0.0.1", "::1"]
    assert names.get_values_for_type(x509.IPAddress) == [ipaddress.ip_address(each) for each in addresses]
    assert hosts_of(certificate(pki / "master.crt")) == ()


def test_init_again_adds_cells_and_keeps_the_rest(tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    init_folder(lab, ["a"], ["slave=10.0.0.1"], 90, NOW)
    before = {path: path.read_bytes() for path in lab.rglob("*.*") if path.name != "router.json5"}
    done = init_folder(lab, ["b"], ["slave=10.0.0.9"], 90, NOW + DAY)
    assert {path: path.read_bytes() for path in before} == before
    assert {str(path.relative_to(lab)) for path, what in done.items() if what == "new"} == {
        f"b/{role}" for role in CELL_ROLES
    }
    assert hosts_of(certificate(lab / "b" / "slave" / "slave.crt")) == ("10.0.0.9",)
    assert (lab / "router" / "router.json5").read_text() == router_file(["b", "a"])


def test_init_asks_for_copies_where_there_is_something_to_copy(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    line = ["pki", "init", str(tmp_path / "lab"), "--cell", "a", "--hosts", "slave=10.0.0.1"]
    for asked in (True, False):
        assert run(line) == 0
        assert ("ca.key" in capsys.readouterr().out) == asked


def test_init_again_renews_what_ends_soon_with_the_same_key(tmp_path: Path) -> None:
    lab, place = tmp_path / "lab", tmp_path / "lab" / "a" / "slave"
    init_folder(lab, ["a"], ["slave=10.0.0.1"], 90, NOW)
    old, keys = certificate(place / "slave.crt"), {path: path.read_bytes() for path in lab.rglob("*.key")}
    assert set(init_folder(lab, [], [], 90, NOW + 59 * DAY).values()) == {"unchanged"}
    assert set(init_folder(lab, [], [], 90, NOW + 61 * DAY).values()) == {"renewed"}
    new = certificate(place / "slave.crt")
    assert new.not_valid_after_utc == NOW + 151 * DAY
    assert (new.subject, hosts_of(new), new.public_key()) == (old.subject, hosts_of(old), old.public_key())
    assert new.serial_number != old.serial_number
    assert {path: path.read_bytes() for path in keys} == keys
    done = init_folder(lab, [], ["slave=10.9.9.9"], 90, NOW + 62 * DAY)
    assert [path for path, what in done.items() if what == "renewed"] == [place]
    assert hosts_of(certificate(place / "slave.crt")) == ("10.9.9.9",)


def test_no_certificate_outlives_its_authority(tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    init_folder(lab, ["a"], [], 90, NOW)
    init_folder(lab, [], [], 365, NOW + 3640 * DAY)
    end = certificate(lab / "a" / "slave" / "slave.crt").not_valid_after_utc
    assert end == certificate(lab / "ca.crt").not_valid_after_utc == NOW + 3650 * DAY
    with pytest.raises(ConfigurationError, match=r"ca\.crt: expired"):
        init_folder(lab, [], [], 365, NOW + 3651 * DAY)


def test_init_again_needs_the_key_of_the_authority(tmp_path: Path) -> None:
    lab, other = tmp_path / "lab", tmp_path / "other"
    for folder in (lab, other):
        init_folder(folder, ["a"], [], 90, NOW)
    shutil.copy(other / "ca.key", lab / "ca.key")
    with pytest.raises(ConfigurationError, match=r"ca\.key: does not belong to ca\.crt"):
        init_folder(lab, ["b"], [], 90, NOW)
    (lab / "ca.key").unlink()
    with pytest.raises(ConfigurationError, match=r"ca\.key: No such file"):
        init_folder(lab, ["b"], [], 90, NOW)


@pytest.mark.parametrize("there", ["folder", "file", "link"])
def test_foreign_folder_is_not_touched(tmp_path: Path, there: str) -> None:
    target = tmp_path / "pki"
    if there == "folder":
        target.mkdir()
        (target / "mine").touch()
    elif there == "file":
        target.touch()
    else:
        target.symlink_to(tmp_path / "else")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ConfigurationError, match="is there already"):
        init_folder(target, ["a"], [], 90, NOW)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("after_days", "colour", "advice"),
    [(0, "green", ""), (59.9, "green", ""), (60.1, "amber", "pki init"), (91, "red", "expired on")],
)
def test_row_of_a_certificate_is_coloured_by_its_end(
    pki: Path, after_days: float, colour: str, advice: str
) -> None:
    found = {row.file: row for row in certificate_rows(pki, NOW + after_days * DAY)}
    assert next(iter(found)) == "ca.crt"
    assert found["ca.crt"].colour == "green"
    slave = found["slave.crt"]
    assert (slave.name, slave.colour) == ("forefeel-cell-slave", colour)
    assert advice in slave.advice
    assert slave.hosts == ("10.0.0.1", "fe80::1", "slave-host.local")
    assert slave.expires == "2027-02-18T12:00:00Z"


def foreign_authority(pki: Path) -> None:
    (pki / "ca.crt").write_bytes(certificate_pem(Authority.new(NOW).certificate))


def other_role(pki: Path) -> None:
    for end in ("crt", "key"):
        shutil.copy(pki / f"viewer.{end}", pki / f"slave.{end}")


WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "folder": (shutil.rmtree, r"pki: no such folder"),
    "certificate": (lambda p: (p / "slave.crt").unlink(), r"slave\.crt: No such file .*pki init"),
    "key": (lambda p: (p / "slave.key").unlink(), r"slave\.key: No such file .*pki init"),
    "authority": (lambda p: (p / "ca.crt").unlink(), r"ca\.crt: No such file .*pki init"),
    "no PEM": (lambda p: (p / "slave.crt").write_bytes(b"\x00x"), r"slave\.crt: no certificate; .*PEM"),
    "an empty key": (lambda p: (p / "slave.key").write_bytes(b""), r"slave\.key: no private key; .*PEM"),
    "another key": (
        lambda p: (p / "slave.key").write_bytes(key_pem(new_key())), r"slave\.key: does not belong",
    ),
    "another authority": (foreign_authority, r"slave\.crt: not signed by ca\.crt"),
    "another role": (other_role, r"slave\.crt: made for forefeel-cell-viewer; expected forefeel-cell-slave"),
    "an open key": (lambda p: (p / "slave.key").chmod(0o604), r"slave\.key: .*every user.*chmod 600"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_said_in_one_line_with_the_file(pki: Path, what: str) -> None:
    read_identity(pki, SLAVE, NOW)
    spoil, words = WRONG[what]
    spoil(pki)
    with pytest.raises(ConfigurationError, match=words) as caught:
        read_identity(pki, SLAVE, NOW)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(pki))


def test_certificate_is_valid_between_its_dates_only(pki: Path) -> None:
    assert read_identity(pki, SLAVE, NOW + 89 * DAY).expires == NOW + 90 * DAY
    for now, words in (
        (NOW + 91 * DAY, r"slave\.crt: expired on 2027-02-18 12:00 UTC; .*pki init"),
        (NOW - timedelta(hours=2), r"ca\.crt: valid from 2026-11-20 11:00 UTC only; .*clock"),
        (NOW + 3651 * DAY, r"ca\.crt: expired on .*new authority"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            read_identity(pki, SLAVE, now)


def test_command_makes_shows_and_extends_a_laboratory(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    lab = str(tmp_path / "lab")
    hosts = ["--hosts", "slave=10.0.0.1,slave-host", "--hosts", "router=10.0.0.5"]
    assert run(["pki", "init", lab, "--cell", "a", "--cell", "b", *hosts, "--days", "20"]) == 0
    assert run(["pki", "init", lab, "--cell", "c", "--days", "90"]) == 0
    capsys.readouterr()
    assert run(["pki", "show", lab, "--json"]) == 0
    found = {row["file"]: row for row in json.loads(capsys.readouterr().out)}
    assert found["a/slave/slave.crt"]["hosts"] == ["10.0.0.1", "slave-host"]
    assert {row["colour"] for row in found.values()} == {"green"}
    assert len(found) == 14
    assert run(["pki", "show", f"{lab}/c/slave"]) == 0
    assert run(["pki", "show", str(expired_pki(tmp_path / "expired"))]) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("pki init @/new", "--cell"),
        *((f"pki init @/new --cell {cell}", "--cell") for cell in ("a/b", "..", ".a", "-a", "*", "router")),
        (f"pki init @/new --cell {'a' * 47}", "--cell"),
        ("pki init @/new --cell a --cell a", "each name once"),
        ("pki init @/new --cell a --hosts boss=h", "'boss' is nobody here"),
        ("pki init @/new --cell a --hosts slave", "--hosts"),
        *(
            (f"pki init @/new --cell a --hosts slave={host}", "expected a host name or an address")
            for host in ("", "10.0.0.1,", "10.0.0.256", "tls/10.0.0.1:7447", "*.lab")
        ),
        ("pki show @/none", "no certificates"),
        ("record --out @/run.mcap", "--connect: missing"),
        ("record --out @/run.mcap --config @/r.yaml --cell a", "expected it alone"),
    ],
)
def test_wrong_input_is_one_line_and_writes_nothing(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: str, words: str
) -> None:
    make_pki(tmp_path / "full")
    before = sorted(tmp_path.rglob("*"))
    assert run(arguments.replace("@", str(tmp_path)).split()) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("transport", "words"),
    [
        ("", "transport.listen: expected at least one endpoint"),
        ("listen: [tcp/0.0.0.0:7447]", "without certificates"),
        ("listen: [tls/0.0.0.0:7447], pki: @/none", "no such folder"),
        ("listen: [tcp/0.0.0.0:7447], pki: @/full", "a plain listener beside certificates"),
    ],
)
def test_router_that_can_not_listen_says_why_in_one_line(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, transport: str, words: str
) -> None:
    make_pki(tmp_path / "full")
    path = tmp_path / "router.yaml"
    path.write_text(f"cells: [cell]\ntransport: {{{transport.replace('@', str(tmp_path))}}}\n")
    assert run(["router", "--config", str(path)]) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") == 1
