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
from tests.commands.conftest import Shell
from tests.secured import expired_pki, make_pki

Run = Callable[[Sequence[str]], int]
NOW = datetime(2026, 11, 20, 12, 0, tzinfo=UTC)
DAY = timedelta(days=1)
SLAVE = Party("slave", ("cell",))
HOSTS = ("10.0.0.1", "fe80::1", "slave-host.local")


@pytest.fixture
def pki(tmp_path: Path) -> Path:
    """All roles of one cell in one folder, valid for 90 days."""
    return make_pki(tmp_path / "pki", hosts={"slave": HOSTS}, now=NOW, days=90)


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
    extension = found.extensions.get_extension_for_class
    both = {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}
    assert set(extension(x509.ExtendedKeyUsage).value) == both
    names = extension(x509.SubjectAlternativeName).value
    hosts = HOSTS if role == "slave" else ()
    assert names.get_values_for_type(x509.DNSName) == [*hosts[2:], "localhost"]
    addresses = [ipaddress.ip_address(each) for each in (*hosts[:2], "127.0.0.1", "::1")]
    assert names.get_values_for_type(x509.IPAddress) == addresses
    assert hosts_of(found) == hosts
    assert found.not_valid_before_utc == NOW - timedelta(hours=1)
    assert found.not_valid_after_utc == NOW + 90 * DAY


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


def test_init_again_with_the_same_hosts_renews_nothing(tmp_path: Path) -> None:
    for done in ("new", "unchanged"):
        hosts = ["slave=localhost,10.0.0.1", "master=127.0.0.1", "router=::1"]
        assert set(init_folder(tmp_path / "lab", ["a"], hosts, 365, NOW).values()) == {done}


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
    for name in ("folder/mine", "file"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "link").symlink_to(tmp_path / "else")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ConfigurationError, match="is there already"):
        init_folder(tmp_path / there, ["a"], [], 90, NOW)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("after_days", "colour", "advice"),
    [(0, "green", ""), (59.9, "green", ""), (60.1, "amber", "pki init"), (91, "red", "expired on")],
)
def test_certificate_is_coloured_by_its_end(pki: Path, after_days: float, colour: str, advice: str) -> None:
    found = {row.file: row for row in certificate_rows(pki, NOW + after_days * DAY)}
    assert next(iter(found)) == "ca.crt"
    assert found["ca.crt"].colour == "green"
    slave = found["slave.crt"]
    assert (slave.name, slave.colour) == ("forefeel-cell-slave", colour)
    assert advice in slave.advice
    assert slave.hosts == HOSTS
    assert slave.expires == "2027-02-18T12:00:00Z"


def other_role(pki: Path) -> None:
    for end in ("crt", "key"):
        shutil.copy(pki / f"viewer.{end}", pki / f"slave.{end}")


def damaged(name: str, data: bytes) -> Callable[[Path], object]:
    return lambda pki: (pki / name).write_bytes(data)


def without(name: str) -> Callable[[Path], object]:
    return lambda pki: (pki / name).unlink()


WRONG: dict[str, tuple[Callable[[Path], object], timedelta, str]] = {
    "folder": (shutil.rmtree, 0 * DAY, r"pki: no such folder"),
    "certificate": (without("slave.crt"), 0 * DAY, r"slave\.crt: No such file .*pki init"),
    "key": (without("slave.key"), 0 * DAY, r"slave\.key: No such file .*pki init"),
    "authority": (without("ca.crt"), 0 * DAY, r"ca\.crt: No such file .*pki init"),
    "no PEM": (damaged("slave.crt", b"\x00x"), 0 * DAY, r"slave\.crt: no certificate; .*PEM"),
    "an empty key": (damaged("slave.key", b""), 0 * DAY, r"slave\.key: no private key; .*PEM"),
    "another key": (damaged("slave.key", key_pem(new_key())), 0 * DAY, r"slave\.key: does not belong"),
    "another authority": (
        damaged("ca.crt", certificate_pem(Authority.new(NOW).certificate)), 0 * DAY,
        r"slave\.crt: not signed by ca\.crt",
    ),
    "another role": (other_role, 0 * DAY, r"slave\.crt: made for forefeel-cell-viewer"),
    "an open key": (lambda pki: (pki / "slave.key").chmod(0o604), 0 * DAY, r"slave\.key: .*chmod 600"),
    "expired": (Path.exists, 91 * DAY, r"slave\.crt: expired on 2027-02-18 12:00 UTC; .*pki init"),
    "the clock": (Path.exists, timedelta(hours=-2), r"ca\.crt: valid from 2026-11-20 11:00 UTC"),
    "an expired authority": (Path.exists, 3651 * DAY, r"ca\.crt: expired on .*new authority"),
}  # fmt: skip


"""(what spoils the folder, the time since it was made, the complaint)"""


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_said_in_one_line_with_the_file(pki: Path, what: str) -> None:
    assert read_identity(pki, SLAVE, NOW + 89 * DAY).expires == NOW + 90 * DAY
    spoil, after, words = WRONG[what]
    spoil(pki)
    with pytest.raises(ConfigurationError, match=words) as caught:
        read_identity(pki, SLAVE, NOW + after)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(pki))


def test_command_makes_extends_a_lab(run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    lab = str(tmp_path / "lab")
    hosts = ["--hosts", "slave=10.0.0.1,slave-host", "--hosts", "router=10.0.0.5"]
    assert run(["pki", "init", lab, "--cell", "a", "--cell", "b", *hosts, "--days", "20"]) == 0
    for asks in (True, False):  # where there is something to copy
        assert run(["pki", "init", lab, "--cell", "c", "--days", "90"]) == 0
        assert ("ca.key" in capsys.readouterr().out) == asks
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
        ("pki init @/new --cell a --cell a", "--cell"),
        ("pki init @/new --cell a --hosts boss=h", "'boss'"),
        ("pki init @/new --cell a --hosts slave", "--hosts"),
        *(
            (f"pki init @/new --cell a --hosts slave={host}", "expected a host name or an address")
            for host in ("", "10.0.0.1,", "10.0.0.256", "tls/10.0.0.1:7447", "*.lab")
        ),
        ("pki show @/none", "no certificates"),
        ("record --out @/run.mcap", "--connect: missing"),
        ("record --out @/run.mcap --config @/r.yaml --cell a", "expected it alone"),
        ("router --config @/nothing.yaml", "transport.listen: expected at least one endpoint"),
        ("router --config @/open.yaml", "without certificates"),
        ("router --config @/missing.yaml", "no such folder"),
        ("router --config @/plain.yaml", "a plain listener beside certificates"),
    ],
)
def test_wrong_input_is_one_line_and_writes_nothing(
    run: Run, capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: str, words: str
) -> None:
    transports = {
        "nothing": "",
        "open": "listen: [tcp/0.0.0.0:7447]",
        "missing": f"listen: [tls/0.0.0.0:7447], pki: {tmp_path}/none",
        "plain": f"listen: [tcp/0.0.0.0:7447], pki: {make_pki(tmp_path / 'full')}",
    }
    files = {f"{name}.yaml": f"cells: [cell]\ntransport: {{{each}}}\n" for name, each in transports.items()}
    Shell(tmp_path, run, capsys).refused(arguments, (words,), files)
