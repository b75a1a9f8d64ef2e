"""The authority and its folder: what is in the certificates, who may read the keys, what is refused."""

import ipaddress
import shutil
import stat
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.transport.pki import read_identity
from forefeel.common.transport.security import CELL_ROLES, Party
from forefeel.pki.authority import Authority, certificate_pem, hosts_of, key_pem, new_key
from forefeel.pki.folder import add_cell, bundle, find_members, read_certificate, renew
from forefeel.pki.layout import checked_cells, members_of, parse_hosts
from forefeel.pki.show import rows
from tests.secured import make_pki

NOW = datetime(2026, 11, 20, 12, 0, tzinfo=UTC)
DAY = timedelta(days=1)
SLAVE = Party("slave", ("cell",))


@pytest.fixture
def pki(tmp_path: Path) -> Path:
    hosts = {"slave": ["10.0.0.1", "fe80::1", "slave-host.local"]}
    return make_pki(tmp_path / "pki", hosts=hosts, now=NOW, days=90)


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def modes(folder: Path) -> dict[str, int]:
    return {str(path.relative_to(folder)): stat.S_IMODE(path.stat().st_mode) for path in folder.rglob("*")}


def test_one_cell_lies_in_the_folder_and_only_its_owner_reads_keys(pki: Path) -> None:
    names = ["ca", "router", *CELL_ROLES]
    assert modes(pki) == {f"{name}.crt": 0o644 for name in names} | {f"{name}.key": 0o600 for name in names}
    assert stat.S_IMODE(pki.stat().st_mode) == 0o700
    assert [path.name for path in pki.parent.iterdir()] == ["pki"]


def test_modes_do_not_depend_on_the_umask(tmp_path: Path) -> None:
    import os

    before = os.umask(0)
    try:
        pki = make_pki(tmp_path / "pki", ("a", "b"))
    finally:
        os.umask(before)
    found = modes(pki)
    assert {mode for name, mode in found.items() if name.endswith(".key")} == {0o600}
    assert (found["a"], found["b"]) == (0o700, 0o700)


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
    read = found.extensions.get_extension_for_class
    assert (read(x509.BasicConstraints).value.ca, read(x509.BasicConstraints).critical) == (False, True)
    usage = read(x509.KeyUsage)
    assert (usage.critical, usage.value.digital_signature, usage.value.key_cert_sign) == (True, True, False)
    both = {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}
    assert set(read(x509.ExtendedKeyUsage).value) == both
    issuer = authority.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value.digest
    assert read(x509.AuthorityKeyIdentifier).value.key_identifier == issuer
    own = x509.SubjectKeyIdentifier.from_public_key(found.public_key()).digest
    assert read(x509.SubjectKeyIdentifier).value.digest == own
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


def test_the_authority_signs_ends_and_no_further_authority(pki: Path) -> None:
    found = certificate(pki / "ca.crt")
    found.verify_directly_issued_by(found)
    constraints = found.extensions.get_extension_for_class(x509.BasicConstraints)
    assert (constraints.value.ca, constraints.value.path_length, constraints.critical) == (True, 0, True)
    usage = found.extensions.get_extension_for_class(x509.KeyUsage).value
    assert (usage.key_cert_sign, usage.digital_signature) == (True, False)
    assert found.not_valid_after_utc == NOW + 3650 * DAY


def test_every_key_and_serial_number_is_another(pki: Path) -> None:
    certificates = [certificate(path) for path in pki.glob("*.crt")]
    assert len({each.serial_number for each in certificates}) == len(certificates) == 6
    assert len({path.read_bytes() for path in pki.glob("*.key")}) == 6


def test_several_cells_have_folders_of_their_own(tmp_path: Path) -> None:
    pki = make_pki(tmp_path / "pki", ("a", "b"), {"b/slave": ["10.0.0.2"], "router": ["10.0.0.5"]}, NOW)
    assert sorted(path.name for path in pki.iterdir()) == [
        "a",
        "b",
        "ca.crt",
        "ca.key",
        "router.crt",
        "router.key",
    ]
    for cell in "ab":
        for role in CELL_ROLES:
            read_identity(pki / cell, Party(role, (cell,)), NOW)
    read_identity(pki, Party("router", ("a", "b")), NOW)
    assert hosts_of(certificate(pki / "b" / "slave.crt")) == ("10.0.0.2",)
    assert hosts_of(certificate(pki / "a" / "slave.crt")) == ()
    with pytest.raises(
        ConfigurationError, match=r"slave.crt: made for forefeel-a-slave; expected forefeel-b-slave"
    ):
        read_identity(pki / "a", Party("slave", ("b",)), NOW)


def test_a_cell_is_added_under_the_same_authority(pki: Path) -> None:
    before = {path: path.read_bytes() for path in pki.rglob("*.*")}
    add_cell(pki, "new", {"new/slave": ["10.0.0.9"]}, 30, NOW)
    assert {path: path.read_bytes() for path in before} == before
    read_identity(pki / "new", Party("slave", ("new",)), NOW)
    assert hosts_of(certificate(pki / "new" / "slave.crt")) == ("10.0.0.9",)
    assert sorted(path.name for path in (pki / "new").glob("*.key")) == sorted(
        f"{role}.key" for role in CELL_ROLES
    )
    for cell in ("cell", "new"):
        with pytest.raises(ConfigurationError, match=f"has a cell {cell}; expected a new name"):
            add_cell(pki, cell, {}, 30, NOW)


@pytest.mark.parametrize("there", ["folder", "file", "link", "dangling"])
def test_what_is_there_is_never_overwritten(tmp_path: Path, there: str) -> None:
    target = tmp_path / "pki"
    if there == "folder":
        target.mkdir()
        (target / "mine").touch()
    elif there == "file":
        target.touch()
    else:
        target.symlink_to(tmp_path / "else")
        if there == "link":
            (tmp_path / "else").mkdir()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ConfigurationError, match="is there already; expected a new folder"):
        make_pki(target)
    assert sorted(tmp_path.rglob("*")) == before


def test_an_empty_folder_is_taken(tmp_path: Path) -> None:
    (tmp_path / "pki").mkdir(mode=0o755)
    pki = make_pki(tmp_path / "pki")
    assert stat.S_IMODE(pki.stat().st_mode) == 0o700


def test_nothing_is_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from forefeel.pki import folder

    calls = 0

    def full(path: Path, content: bytes, mode: int) -> None:
        nonlocal calls
        calls += 1
        if calls == 7:
            raise OSError(28, "No space left on device")
        path.write_bytes(content)

    monkeypatch.setattr(folder, "_write", full)
    with pytest.raises(RunError, match="pki: No space left on device, nothing is written"):
        make_pki(tmp_path / "pki")
    assert list(tmp_path.iterdir()) == []


def test_a_renewal_keeps_key_and_hosts_and_replaces_the_certificate_alone(pki: Path) -> None:
    keys = {path: path.read_bytes() for path in pki.glob("*.key")}
    old = certificate(pki / "slave.crt")
    untouched = (pki / "master.crt").read_bytes()
    later = NOW + 80 * DAY
    members = [each for each in find_members(pki) if each.party.role == "slave"]
    renew(pki, members, {}, 90, later)
    new = certificate(pki / "slave.crt")
    assert new.not_valid_after_utc == later + 90 * DAY
    assert (new.subject, hosts_of(new), new.public_key()) == (old.subject, hosts_of(old), old.public_key())
    assert new.serial_number != old.serial_number
    assert {path: path.read_bytes() for path in keys} == keys
    assert (pki / "master.crt").read_bytes() == untouched
    read_identity(pki, SLAVE, later + 89 * DAY)
    renew(pki, members, {"slave": ["10.9.9.9"]}, 90, later)
    assert hosts_of(certificate(pki / "slave.crt")) == ("10.9.9.9",)
    assert not [path for path in pki.iterdir() if path.name.endswith(".part")]


def test_no_certificate_outlives_its_authority(pki: Path) -> None:
    almost = NOW + 3640 * DAY
    renew(pki, find_members(pki), {}, 365, almost)
    assert certificate(pki / "slave.crt").not_valid_after_utc == NOW + 3650 * DAY
    with pytest.raises(ConfigurationError, match=r"ca\.crt: expired; expected a new authority"):
        renew(pki, find_members(pki), {}, 365, NOW + 3651 * DAY)


def test_renewing_needs_the_authority_s_own_key(pki: Path, tmp_path: Path) -> None:
    shutil.copy(make_pki(tmp_path / "other") / "ca.key", pki / "ca.key")
    with pytest.raises(ConfigurationError, match=r"ca\.key: does not belong to ca\.crt"):
        renew(pki, find_members(pki), {}, 30, NOW)
    (pki / "ca.key").unlink()
    with pytest.raises(ConfigurationError, match=r"ca\.key: No such file"):
        renew(pki, find_members(pki), {}, 30, NOW)


def test_a_bundle_holds_what_one_host_needs(pki: Path, tmp_path: Path) -> None:
    slave = next(each for each in find_members(pki) if each.party.role == "slave")
    out = tmp_path / "for-the-slave" / "pki"
    assert bundle(pki, slave, out) == ["ca.crt", "slave.crt", "slave.key"]
    assert modes(out) == {"ca.crt": 0o644, "slave.crt": 0o644, "slave.key": 0o600}
    read_identity(out, SLAVE, NOW)
    with pytest.raises(ConfigurationError, match="is there already"):
        bundle(pki, slave, out)


@pytest.mark.parametrize(
    ("after_days", "colour", "advice"),
    [(0, "green", ""), (59.9, "green", ""), (60.1, "amber", "forefeel pki renew"), (91, "red", "expired on")],
)
def test_show_tells_what_expires(pki: Path, after_days: float, colour: str, advice: str) -> None:
    found = {row.file: row for row in rows(pki, NOW + after_days * DAY)}
    assert next(iter(found)) == "ca.crt"
    assert found["ca.crt"].colour == "green"
    slave = found["slave.crt"]
    assert (slave.name, slave.colour) == ("forefeel-cell-slave", colour)
    assert advice in slave.advice
    assert slave.hosts == ("10.0.0.1", "fe80::1", "slave-host.local")
    assert slave.expires == "2027-02-18T12:00:00Z"


def test_show_sees_a_key_that_is_open_to_others(pki: Path) -> None:
    (pki / "slave.key").chmod(0o644)
    colours = {row.file: row.colour for row in rows(pki, NOW)}
    assert [file for file, colour in colours.items() if colour != "green"] == ["slave.crt"]


def foreign_authority(pki: Path) -> None:
    (pki / "ca.crt").write_bytes(certificate_pem(Authority.new(NOW).certificate))


def key_as_folder(pki: Path) -> None:
    (pki / "slave.key").unlink()
    (pki / "slave.key").mkdir()


def other_role(pki: Path) -> None:
    for end in ("crt", "key"):
        shutil.copy(pki / f"viewer.{end}", pki / f"slave.{end}")


WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "folder": (shutil.rmtree, r"pki: no such folder; .*forefeel pki init .*/pki --cell cell --hosts slave="),
    "certificate": (lambda p: (p / "slave.crt").unlink(), r"slave\.crt: No such file .*forefeel pki init"),
    "key": (lambda p: (p / "slave.key").unlink(), r"slave\.key: No such file .*forefeel pki init"),
    "authority": (lambda p: (p / "ca.crt").unlink(), r"ca\.crt: No such file .*forefeel pki init"),
    "a folder as key": (key_as_folder, r"slave\.key: Is a directory"),
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


def test_an_expired_certificate_says_when_and_how_to_renew(pki: Path) -> None:
    assert read_identity(pki, SLAVE, NOW + 89 * DAY).expires == NOW + 90 * DAY
    with pytest.raises(
        ConfigurationError,
        match=r"slave\.crt: expired on 2027-02-18 12:00 UTC; .*forefeel pki renew DIR where ca\.key",
    ):
        read_identity(pki, SLAVE, NOW + 91 * DAY)
    with pytest.raises(ConfigurationError, match=r"ca\.crt: valid from 2026-11-20 11:00 UTC only; .*clock"):
        read_identity(pki, SLAVE, NOW - timedelta(hours=2))
    with pytest.raises(
        ConfigurationError, match=r"ca\.crt: expired on .*forefeel pki init makes a new authority"
    ):
        read_identity(pki, SLAVE, NOW + 3651 * DAY)


@pytest.mark.parametrize(
    "cell", ["", "a/b", "..", ".a", "-a", "a b", "*", "a" * 47, "é", "a\n", "x.crt", "a,b"]
)
def test_names_that_can_not_stand_everywhere_are_refused(cell: str) -> None:
    with pytest.raises(ConfigurationError, match="--cell"):
        checked_cells([cell])


def test_a_cell_stands_once() -> None:
    assert checked_cells(["a", "b-1_x.y"]) == ("a", "b-1_x.y")
    with pytest.raises(ConfigurationError, match="expected each name once"):
        checked_cells(["a", "a"])


def test_hosts_of_a_role_are_those_of_every_cell_or_of_one() -> None:
    members = members_of(["a", "b"], apart=True)
    words = ["slave=10.0.0.1, host-1", "b/slave=[fe80::1]", "router=r.example.org"]
    assert parse_hosts(words, members) == {
        "a/slave": ("10.0.0.1", "host-1"),
        "b/slave": ("10.0.0.1", "host-1", "fe80::1"),
        "router": ("r.example.org",),
    }


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("slave", "expected ROLE=HOST,HOST"),
        ("boss=10.0.0.1", "'boss' is nobody here; expected one of slave, master, recorder, viewer, router"),
        ("slave=", "expected a host name or an address"),
        ("slave=10.0.0.1,", "expected a host name or an address"),
        ("slave=10.0.0.256", "expected a host name or an address"),
        ("slave=a b", "expected a host name or an address"),
        ("slave=tls/10.0.0.1:7447", "expected a host name or an address"),
        ("slave=*.lab", "expected a host name or an address"),
    ],
)
def test_hosts_that_are_none_are_refused(word: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        parse_hosts([word], members_of(["cell"], apart=False))


def test_a_folder_without_certificates_is_none_of_ours(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no certificates; expected a folder of forefeel pki init"):
        find_members(tmp_path / "nowhere")
    foreign = Authority.new(NOW)
    key = new_key()
    signed = foreign.sign("somebody", key.public_key(), [], NOW, 1)
    (tmp_path / "somebody.crt").write_bytes(certificate_pem(signed))
    with pytest.raises(ConfigurationError, match="no certificates"):
        find_members(tmp_path)
    assert read_certificate(tmp_path / "somebody.crt").subject.get_attributes_for_oid(NameOID.COMMON_NAME)
