"""X.509 certificates: an authority on EC P-256 and what it signs (RFC 5280)."""

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

AUTHORITY_NAME = "forefeel-ca"
AUTHORITY_DAYS = 3650
EARLIER = timedelta(hours=1)  # before now a certificate begins: hosts' clocks need not agree to the second
THIS_HOST = ("localhost", "127.0.0.1", "::1")

Key = ec.EllipticCurvePrivateKey
PublicKey = ec.EllipticCurvePublicKey


@dataclass(frozen=True, slots=True)
class Authority:
    """The certificate that every end trusts, and the key that signs the others."""

    certificate: x509.Certificate
    key: Key

    @classmethod
    def new(cls, now: datetime) -> "Authority":
        """Makes a key and its self-signed certificate, valid from an hour before `now` for ten years; it
        signs certificates of ends, of no other authority. Writes nothing.
        """
        key = new_key()
        name, identifier = _name(AUTHORITY_NAME), x509.SubjectKeyIdentifier.from_public_key(key.public_key())
        builder = (
            _unsigned(name, name, key.public_key(), now, now + timedelta(days=AUTHORITY_DAYS), identifier)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_certificates=True), critical=True)
        )
        return cls(builder.sign(key, hashes.SHA256()), key)

    def sign(
        self, name: str, public_key: PublicKey, hosts: Sequence[str], now: datetime, days: int
    ) -> x509.Certificate:
        """Makes the certificate of an end that both listens and connects, signed by this authority.

        Args:
            name: common name, by which the access control knows it.
            public_key: the end's own.
            hosts: names and addresses under which others reach it; this host's own are added.
            now: it is valid from an hour before.
            days: and until so many days later, or as long as the authority.
        """
        identifier = self.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
        end = min(now + timedelta(days=days), self.certificate.not_valid_after_utc)
        names = [_general_name(host) for host in dict.fromkeys([*hosts, *THIS_HOST])]
        purposes = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        builder = (
            _unsigned(_name(name), self.certificate.subject, public_key, now, end, identifier)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_certificates=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
            .add_extension(x509.SubjectAlternativeName(names), critical=False)
        )
        return builder.sign(self.key, hashes.SHA256())


def new_key() -> Key:
    return ec.generate_private_key(ec.SECP256R1())


def key_pem(key: Key) -> bytes:
    """The private key as PKCS 8, not encrypted: a daemon starts without a person."""
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def certificate_pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def hosts_of(certificate: x509.Certificate) -> tuple[str, ...]:
    """Names and addresses in a certificate but for localhost and its addresses; maybe none."""
    try:
        alternatives = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    names = [str(name.value) for name in alternatives]
    return tuple(name for name in names if name not in THIS_HOST)


def _unsigned(
    subject: x509.Name,
    issuer: x509.Name,
    public_key: PublicKey,
    now: datetime,
    end: datetime,
    signer: x509.SubjectKeyIdentifier,
) -> x509.CertificateBuilder:
    """Builder of a certificate, not signed yet, with subject, issuer, key, period from an hour before `now`
    to `end`, and the identifiers of both keys; `signer`: that of the issuer's key.
    """
    signed_by = x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(signer)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(public_key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public_key), critical=False)
        .add_extension(signed_by, critical=False)
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _usage(signs_certificates: bool) -> x509.KeyUsage:
    """Extension that allows a key to sign certificates and revocation lists, or else signatures alone."""
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
