"""A small certificate authority for one cell: its own certificate, those it signs, those revoked.

Keys are on the curve P-256.  Everything lies in one folder, PEM files that belong to their owner
alone: ``ca.pem`` and ``ca.key``, ``crl.pem``, and ``NAME.pem`` and ``NAME.key`` of everybody else.
"""

from __future__ import annotations

import datetime
import ipaddress
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from orientd.errors import ConfigError

CA_DAYS = 3650
BACKDATED = datetime.timedelta(minutes=5)
"""How far before its making a certificate counts, for clocks that are behind."""

RESERVED = ("ca", "crl")


@dataclass(frozen=True)
class Issued:
    """A certificate that the authority has signed.

    Attributes:
        name: of whom it is.
        serial: hexadecimal.
        expires: when it does, UTC.
        is_server: whether it is for a daemon.
        is_revoked: whether it counts no longer.
        certificate: where it is.
        key: where its key is.
    """

    name: str
    serial: str
    expires: datetime.datetime
    is_server: bool
    is_revoked: bool
    certificate: Path
    key: Path


class Authority:
    """Sign and revoke certificates in one folder."""

    def __init__(self, folder: Path) -> None:
        """Use the authority in *folder*.

        Raises:
            ConfigError: there is none.
        """
        self._folder = folder
        self._certificate = _load(folder / "ca.pem")
        self._key = _load_key(folder / "ca.key")

    @classmethod
    def make(cls, folder: Path, name: str) -> Authority:
        """Make an authority called *name* in *folder*, with an empty revocation list.

        Raises:
            ConfigError: there is one already, or the folder cannot be written to.
        """
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"cannot make {folder}: {error.strerror}") from error
        if (folder / "ca.key").exists():
            raise ConfigError(f"{folder} has an authority already")
        key = ec.generate_private_key(ec.SECP256R1())
        subject = _name(name)
        builder = (
            _builder(subject, subject, key.public_key(), CA_DAYS)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs=True), critical=True)
        )
        _write_key(folder / "ca.key", key)
        _write(folder / "ca.pem", _pem(builder.sign(key, hashes.SHA256())), 0o644)
        authority = cls(folder)
        authority._write_list([])
        return authority

    def issue(self, name: str, *, days: float, hosts: Sequence[str] = ()) -> Issued:
        """Sign a certificate for *name*, and write it and its key.

        Args:
            name: of a client, by which the daemon's settings give it a role.
            days: how long it lasts.
            hosts: names and addresses at which a daemon is reached; makes it a server's.

        Raises:
            ConfigError: the name is in use or cannot be one.
        """
        if not name or name in RESERVED or "/" in name or name.startswith(".") or len(name) > 64:
            raise ConfigError(
                "expected a name of at most 64 characters, without / and no dot in front, and none "
                f"of {', '.join(sorted(RESERVED))}; got {name!r}"
            )
        certificate, key_path = self._folder / f"{name}.pem", self._folder / f"{name}.key"
        if certificate.exists():
            raise ConfigError(f"{certificate} is there already: revoke it and move it away first")
        key = ec.generate_private_key(ec.SECP256R1())
        use = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
        builder = (
            _builder(_name(name), self._certificate.subject, key.public_key(), days)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage([use]), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key()),
                critical=False,
            )
        )
        if hosts:
            listed = x509.SubjectAlternativeName([_host(host) for host in hosts])
            builder = builder.add_extension(listed, critical=False)
        signed = builder.sign(self._key, hashes.SHA256())
        _write_key(key_path, key)
        _write(certificate, _pem(signed), 0o644)
        return self._issued(signed, certificate, frozenset())

    def revoke(self, name: str) -> Issued:
        """Put the certificate of *name* on the revocation list.

        Raises:
            ConfigError: there is none of that name.
        """
        path = self._folder / f"{name}.pem"
        certificate = _load(path)
        revoked = [one for one in self._list() if one.serial_number != certificate.serial_number]
        now = datetime.datetime.now(datetime.UTC)
        entry = x509.RevokedCertificateBuilder()
        entry = entry.serial_number(certificate.serial_number).revocation_date(now)
        self._write_list([*revoked, entry.build()])
        return self._issued(certificate, path, frozenset({certificate.serial_number}))

    def issued(self) -> list[Issued]:
        """Return every certificate in the folder that the authority has signed, by name."""
        revoked = frozenset(one.serial_number for one in self._list())
        return [
            self._issued(_load(path), path, revoked)
            for path in sorted(self._folder.glob("*.pem"))
            if path.stem not in RESERVED
        ]

    def _list(self) -> list[x509.RevokedCertificate]:
        try:
            content = (self._folder / "crl.pem").read_bytes()
        except FileNotFoundError:
            return []
        return list(x509.load_pem_x509_crl(content))

    def _write_list(self, revoked: Sequence[x509.RevokedCertificate]) -> None:
        now = datetime.datetime.now(datetime.UTC)
        builder = x509.CertificateRevocationListBuilder(
            issuer_name=self._certificate.subject,
            # A list that runs out would lock everybody out.
            last_update=now - BACKDATED,
            next_update=self._certificate.not_valid_after_utc,
            revoked_certificates=list(revoked),
        )
        signed = builder.sign(self._key, hashes.SHA256())
        _write(self._folder / "crl.pem", signed.public_bytes(serialization.Encoding.PEM), 0o644)

    def _issued(self, certificate: x509.Certificate, path: Path, revoked: frozenset[int]) -> Issued:
        use = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        return Issued(
            name=str(certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value),
            serial=f"{certificate.serial_number:X}",
            expires=certificate.not_valid_after_utc,
            is_server=ExtendedKeyUsageOID.SERVER_AUTH in use,
            is_revoked=certificate.serial_number in revoked,
            certificate=path,
            key=path.with_suffix(".key"),
        )


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: float
) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    end = now + datetime.timedelta(days=days)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(min(now, end) - BACKDATED)
        .not_valid_after(end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs,
        crl_sign=signs,
        encipher_only=False,
        decipher_only=False,
    )


def _name(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _load(path: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: expected a certificate (PEM): {error}") from error


def _load_key(path: Path) -> ec.EllipticCurvePrivateKey:
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: expected a private key (PEM): {error}") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ConfigError(f"{path}: expected a key on an elliptic curve")
    return key


def _write_key(path: Path, key: ec.EllipticCurvePrivateKey) -> None:
    content = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    _write(path, content, 0o600)


def _write(path: Path, content: bytes, mode: int) -> None:
    """Write all of a file or nothing: a daemon may read it at any time."""
    beside = path.with_name(f".{path.name}.new")
    beside.unlink(missing_ok=True)
    try:
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(content)
        beside.replace(path)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error
