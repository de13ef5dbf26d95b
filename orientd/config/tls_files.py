"""Check the certificate, key and authority files of one end of a TLS connection.

OpenSSL says "PEM lib" of most files that are something else, and asks for the password of a key.
"""

from __future__ import annotations

import re
import ssl
from binascii import a2b_base64
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from orientd.errors import ConfigError
from orientd.files import MEBIBYTE, read_bounded

_KINDS = {
    "ENCRYPTED PRIVATE KEY": "a private key with a password",
    "PRIVATE KEY": "a private key",
    "X509 CRL": "a list of revoked certificates",
    "CERTIFICATE REQUEST": "a request for a certificate",
    "PUBLIC KEY": "a public key",
    "CERTIFICATE": "a certificate",
}
_DER = b"\x30"
"""First byte of a certificate, key or list in DER."""
_PEM = re.compile(rb"-----BEGIN CERTIFICATE-----(.+?)-----END", re.DOTALL)
_VERSION, _UTC_TIME = 0xA0, 0x17
"""Tags of a certificate's version, and of a time with two digits of the year (RFC 5280, 4.1)."""


class TlsFileError(ConfigError):
    """A file is not what it should be.

    Attributes:
        name: which one: ``certificate``, ``key``, ``ca`` or ``crl``.
    """

    def __init__(self, name: str, problem: str) -> None:
        """Keep what is wrong with the file *name*."""
        super().__init__(problem)
        self.name = name


def check_tls_files(certificate: Path, key: Path, ca: Path, crl: Path | None = None) -> None:
    """Check that each file can be read and is of its kind, and that certificate and key are valid.

    The key has to fit the certificate, and the certificate must not have expired.

    Nothing is checked if one is a pipe, which can be read only once.

    Args:
        certificate: of this end, PEM.
        key: of that certificate, PEM.
        ca: authorities that sign the certificates of the other end, PEM.
        crl: the authority's list of revoked certificates, PEM.

    Raises:
        TlsFileError: one is not as it should be.
    """
    if any(path is not None and path.is_fifo() for path in (certificate, key, ca, crl)):
        return
    for name, path, kind in (
        ("certificate", certificate, "CERTIFICATE"),
        ("key", key, "PRIVATE KEY"),
        ("ca", ca, "CERTIFICATE"),
        ("crl", crl, "X509 CRL"),
    ):
        if path is not None:
            _check_kind(name, path, kind)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    for name, path in (("certificate", certificate), ("ca", ca), ("crl", crl)):
        if path is None:
            continue
        try:
            context.load_verify_locations(path)
        except ssl.SSLError as error:
            problem = f"{path}: {_KINDS['X509 CRL' if name == 'crl' else 'CERTIFICATE']} in it is "
            raise TlsFileError(name, f"{problem}damaged ({error.reason}); copy it again") from error
    try:
        # Without a password OpenSSL would ask for one.
        context.load_cert_chain(certificate, key, password="")
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            problem = f"the key {key} does not belong to the certificate {certificate}"
        else:
            problem = f"{key}: the private key in it is damaged; copy it again"
        raise TlsFileError("key", problem) from error
    expiry = _expiry(certificate)
    if expiry < datetime.now(UTC):
        problem = f"{certificate}: the certificate in it expired on {expiry:%Y-%m-%d %H:%M} UTC"
        raise TlsFileError("certificate", f"{problem}; have the authority sign a new one")
    authorities = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    authorities.load_verify_locations(ca)
    if not authorities.get_ca_certs():
        expected = "expected the certificate of an authority, found one that signs no others"
        raise TlsFileError("ca", f"{ca}: {expected}; give the file that signed the other end")


def _expiry(path: Path) -> datetime:
    """Return until when the first certificate in a file counts; OpenSSL has accepted the file.

    The time is the second one of the field ``validity`` (RFC 5280, 4.1.2.5).
    """
    match = _PEM.search(read_bounded(path, MEBIBYTE))
    if match is None:  # of a kind that older OpenSSL wrote
        return datetime.max.replace(tzinfo=UTC)
    ((_, certificate),) = _elements(a2b_base64(match[1]))
    fields = [field for tag, field in _elements(next(_elements(certificate))[1]) if tag != _VERSION]
    _, (tag, text) = _elements(fields[3])
    century = "" if tag != _UTC_TIME else "19" if text >= b"50" else "20"
    return datetime.strptime(f"{century}{text.decode()}", "%Y%m%d%H%M%SZ").replace(tzinfo=UTC)


def _elements(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the tag and the content of each element of DER."""
    at = 0
    while at < len(content):
        tag, size = content[at : at + 2]
        at += 2
        if size & 0x80:
            digits = size & 0x7F
            size = int.from_bytes(content[at : at + digits])
            at += digits
        yield tag, content[at : at + size]
        at += size


def _check_kind(name: str, path: Path, kind: str) -> None:
    """Check that a file holds an object of a kind in PEM.

    Raises:
        TlsFileError: it cannot be read, or holds none.
    """
    try:
        content = read_bounded(path, MEBIBYTE)
    except OSError as error:
        raise TlsFileError(name, f"cannot read {path}: {error.strerror}") from error
    marks = [mark for mark in _KINDS if f"{mark}-----".encode() in content]
    is_locked = "ENCRYPTED PRIVATE KEY" in marks or b"Proc-Type: 4,ENCRYPTED" in content
    if kind == "PRIVATE KEY" and is_locked:
        raise TlsFileError(
            name,
            f"{path}: expected a private key without a password; remove the password with "
            f"`openssl pkey -in {path} -out NEW`",
        )
    if kind in marks:
        return
    if marks:
        found, step = _KINDS[marks[0]], "give the file of the right kind"
    elif not content.strip():
        found, step = "an empty file", "write it again"
    elif content.startswith(_DER):
        tool = {"CERTIFICATE": "x509", "PRIVATE KEY": "pkey", "X509 CRL": "crl"}[kind]
        found, step = "DER", f"convert it with `openssl {tool} -inform DER -in {path} -out NEW`"
    else:
        found, step = "no PEM", "give a file with a line -----BEGIN ...-----"
    raise TlsFileError(name, f"{path}: expected {_KINDS[kind]} in PEM, found {found}; {step}")
