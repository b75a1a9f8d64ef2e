"""Is the traffic secured, by certificates that are valid, the right ones, and not open to others?"""

import stat
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forefeel.common.clock import now_utc
from forefeel.common.errors import ConfigurationError, EndpointError
from forefeel.common.settings import DaemonSettings
from forefeel.common.topics import Role
from forefeel.common.transport.exposure import check_exposure
from forefeel.common.transport.pki import AUTHORITY, read_certificate, read_identity
from forefeel.common.transport.security import Party, PartyFiles
from forefeel.common.transport.zenoh_config import secured_by_file
from forefeel.doctor.findings import Finding, Level

GROUP = "certificates"
# days before the end from which it is amber, as in `forefeel pki show` (`pki.show.AMBER_DAYS`)
_SOON_DAYS = 30
_EVERYWHERE = {"0.0.0.0", "[::]", "::"}
_THIS_HOST = {"127.0.0.1", "[::1]", "::1", "localhost"}


@dataclass(frozen=True, slots=True)
class Certificate:
    """What lies in the folder for one role. `error`: why it can not be used; `days_left`: until the first of
    certificate and authority expires; `folder_mode`, `key_mode`: permissions, None where there is none.
    """

    name: str
    folder: str
    error: str = ""
    days_left: int = 0
    hosts: tuple[str, ...] = ()
    folder_mode: int | None = None
    key_mode: int | None = None
    signs: bool = False


def find_identity(settings: DaemonSettings, role: Role) -> PartyFiles | None:
    """The files of the role that can be used; None where there are none."""
    folder = settings.transport.pki
    if folder is None:
        return None
    try:
        return read_identity(folder, Party(role, (settings.cell,)), now_utc()).identity
    except ConfigurationError:
        return None


def read_folder(folder: Path, role: Role, cell: str) -> Certificate:
    """The certificate of the role in a folder of `forefeel pki init`."""
    from forefeel.pki.authority import hosts_of  # noqa: PLC0415 - loads the library of certificates

    party, now = Party(role, (cell,)), now_utc()
    modes = _mode(folder), _mode(folder / f"{role}.key")
    signs = (folder / "ca.key").exists()
    try:
        hosts = hosts_of(read_certificate(folder / f"{role}.crt"))
        ends = [read_certificate(folder / each).not_valid_after_utc for each in (AUTHORITY, f"{role}.crt")]
        days = (min(ends) - now).days
        read_identity(folder, party, now)
    except ConfigurationError as error:
        return Certificate(party.name, str(folder), str(error), 0, (), *modes, signs)
    return Certificate(party.name, str(folder), "", days, hosts, *modes, signs)


def judge_exposure(settings: DaemonSettings, role: Role) -> Finding:
    """Whether what is open to a network is secured."""
    transport, subject = settings.transport, f"{role}'s traffic"
    try:
        secured = transport.pki is not None or secured_by_file(transport)
        notice = check_exposure(
            transport.listen,
            transport.connect,
            secured=secured,
            insecure=True,
            real_stage=settings.real_stage,
        )
    except (ConfigurationError, EndpointError) as error:
        return Finding(GROUP, subject, "red", str(error), "forefeel pki init, then name the folder")
    if notice:
        advice = (
            "forefeel pki init DIR --cell NAME, and transport.pki: DIR; else it starts with --insecure only"
        )
        return Finding(GROUP, subject, "red", notice, advice)
    found = "certificates on every endpoint" if secured else "stays on this host, needs no certificates"
    return Finding(GROUP, subject, "green", found)


def judge_certificate(found: Certificate, listen: Sequence[str]) -> list[Finding]:
    """Validity, names and modes; `listen`: where others reach this end."""
    if found.error:
        advice = "forefeel pki bundle on the host with ca.key puts together what this host needs"
        return [Finding(GROUP, found.name, "red", found.error, advice), *_modes(found)]
    return [_validity(found), *_names(found, listen), *_modes(found)]


def _validity(found: Certificate) -> Finding:
    soon = found.days_left < _SOON_DAYS
    advice = "forefeel pki renew on the host with ca.key, then copy it here" if soon else ""
    level: Level = "amber" if soon else "green"
    return Finding(GROUP, found.name, level, f"valid, {found.days_left} days left", advice)


def _names(found: Certificate, listen: Sequence[str]) -> list[Finding]:
    """Others check the name under which they connect."""
    wanted = [endpoint.partition("/")[2].rpartition(":")[0] for endpoint in listen]
    outside = [host for host in wanted if host not in _THIS_HOST]
    if not outside:
        return []
    subject, named = f"{found.name}, names", ", ".join(found.hosts) or "none but this host's own"
    missing = [host for host in outside if host not in _EVERYWHERE and host.strip("[]") not in found.hosts]
    advice = "forefeel pki renew DIR ROLE --hosts ROLE=ADDRESS with the address that others use"
    if missing:
        return [Finding(GROUP, subject, "red", f"{named}; not {', '.join(missing)}", advice)]
    if not found.hosts:
        return [Finding(GROUP, subject, "red", f"{named}: no other host accepts it", advice)]
    return [Finding(GROUP, subject, "green", named)]


def _modes(found: Certificate) -> list[Finding]:
    findings = []
    if found.key_mode is not None:
        level: Level = "red" if found.key_mode & 0o007 else "amber" if found.key_mode & 0o070 else "green"
        advice = "" if level == "green" else "chmod 600: whoever reads the key is this role"
        findings.append(Finding(GROUP, f"{found.name}, key", level, f"mode {found.key_mode:04o}", advice))
    if found.folder_mode is not None and found.folder_mode & 0o022:
        what = f"{found.folder}: mode {found.folder_mode:04o}, others may put files there"
        findings.append(Finding(GROUP, f"{found.name}, folder", "red", what, f"chmod 700 {found.folder}"))
    if found.signs:
        what = f"{found.folder}/ca.key lies on this host"
        advice = "keep it off the hosts: whoever has it makes any certificate"
        findings.append(Finding(GROUP, "authority", "amber", what, advice))
    return findings


def _mode(path: Path) -> int | None:
    try:
        return stat.S_IMODE(path.stat().st_mode)
    except OSError:
        return None
