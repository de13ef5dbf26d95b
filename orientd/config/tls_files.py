"""Check the certificate, key and authority files of one end of a TLS connection.

OpenSSL says "PEM lib" of most files that are something else, and asks for the password of a key.
"""

from __future__ import annotations

import errno
import re
import ssl
from binascii import a2b_base64
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from orientd.errors import ConfigError
from orientd.files import MEBIBYTE, read_bounded

_KINDS = {
    "OPENSSH PRIVATE KEY": "a private key of OpenSSH",
    "ENCRYPTED PRIVATE KEY": "a private key with a password",
    "PRIVATE KEY": "a private key",
    "X509 CRL": "a list of revoked certificates",
    "CERTIFICATE REQUEST": "a request for a certificate",
    "PUBLIC KEY": "a public key",
    "CERTIFICATE": "a certificate",
}
_DER = b"\x30"
"""First byte of a certificate, key or list in DER."""
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_PEM = {
    kind: re.compile(rb"-----BEGIN %b-----(.+?)-----END" % kind.encode(), re.DOTALL)
    for kind in ("CERTIFICATE", "X509 CRL")
}
_INTEGER, _VERSION, _UTC_TIME, _TIME = 0x02, 0xA0, 0x17, 0x18
"""Tags of a number, of a certificate's version, and of times with two and with four digits of the
year (RFC 5280, 4.1)."""
_PKCS_12 = 3
"""First number of a file of PKCS #12, its version (RFC 7292, 4)."""
_NEXT_STEPS = {
    errno.ENOENT: "check the path",
    errno.EACCES: "let this user read it",
    errno.EISDIR: "give a file in it",
}
_WEAK = {
    "EE_KEY_TOO_SMALL": "its key is too short; make one of 2048 bits, or of a curve",
    "CA_KEY_TOO_SMALL": "the key that signed it is too short; make one of 2048 bits, or of a curve",
    "CA_MD_TOO_WEAK": "its signature is of an old kind; have the authority sign with SHA-256",
}
"""Weak certificates by OpenSSL's words, each with the next step."""


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
            problem += "; give the key that was made with it"
        elif error.reason in _WEAK:
            problem = f"{certificate}: TLS does not accept the certificate in it: "
            raise TlsFileError("certificate", problem + _WEAK[error.reason]) from error
        else:
            problem = f"{key}: the private key in it is damaged; copy it again"
        raise TlsFileError("key", problem) from error
    _check_times(certificate, ca, crl)
    authorities = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    authorities.load_verify_locations(ca)
    if not authorities.get_ca_certs():
        expected = "expected the certificate of an authority, found one that signs no others"
        raise TlsFileError("ca", f"{ca}: {expected}; give the file that signed the other end")
    lists = [_fields(content, _INTEGER)[1] for content in _contents(crl, "X509 CRL")]
    if lists and not {*lists} & {subject for *_, subject in _certificates(ca)}:
        expected = f"expected a list of the authority in {ca}, found one of another"
        raise TlsFileError("crl", f"{crl}: {expected}; give the list that it signed")


def _check_times(certificate: Path, ca: Path, crl: Path | None) -> None:
    """Check that the certificate, an authority and the list of revoked ones count now.

    Raises:
        TlsFileError: one does not.
    """
    now = datetime.now(UTC)
    for begin, end, _ in list(_certificates(certificate))[:1]:
        if end < now:
            problem = f"{certificate}: the certificate in it expired on {_shown(end)}"
            raise TlsFileError("certificate", f"{problem}; have the authority sign a new one")
        if begin > now:
            problem = f"{certificate}: the certificate in it counts from {_shown(begin)}"
            step = "set the clock of this machine, or have the authority sign a new one"
            raise TlsFileError("certificate", f"{problem}; {step}")
    ends = [end for _, end, _ in _certificates(ca)]
    if ends and max(ends) < now:
        problem = f"{ca}: the authority in it expired on {_shown(max(ends))}"
        raise TlsFileError("ca", f"{problem}; make a new one, and have it sign the certificates")
    for content in _contents(crl, "X509 CRL"):
        _, _, _, following, *_ = [*_parts(content, _INTEGER), (0, b"")]
        if following[0] in {_UTC_TIME, _TIME} and (end := _time(following)) < now:
            problem = f"{crl}: the list in it expired on {_shown(end)}"
            raise TlsFileError("crl", f"{problem}; have the authority sign a new one")


def _shown(time: datetime) -> str:
    return f"{time:%Y-%m-%d %H:%M} UTC"


def _certificates(path: Path) -> Iterator[tuple[datetime, datetime, bytes]]:
    """Yield begin, end and subject of each certificate in a file; OpenSSL has accepted the file.

    The times are those of the field ``validity`` (RFC 5280, 4.1.2.5).
    """
    for content in _contents(path, "CERTIFICATE"):
        _, _, _, validity, subject, *_ = _fields(content, _VERSION)
        begin, end = _elements(validity)
        yield _time(begin), _time(end), subject


def _contents(path: Path | None, kind: str) -> list[bytes]:
    """Return each object of a kind in a file in PEM; none of a kind that older OpenSSL wrote."""
    found = [] if path is None else _PEM[kind].findall(read_bounded(path, MEBIBYTE))
    return [content for text in found for _, content in _elements(a2b_base64(text))]


def _fields(content: bytes, version: int) -> list[bytes]:
    """Return the signed fields of a certificate or list, without its version."""
    return [field for _, field in _parts(content, version)]


def _parts(content: bytes, version: int) -> list[tuple[int, bytes]]:
    """Return the fields, as in :func:`_fields`, each with its tag."""
    parts = list(_elements(next(_elements(content))[1]))
    return parts[1:] if parts[0][0] == version else parts


def _time(element: tuple[int, bytes]) -> datetime:
    tag, text = element
    century = "" if tag != _UTC_TIME else "19" if text >= b"50" else "20"
    return datetime.strptime(f"{century}{text.decode()}", "%Y%m%d%H%M%SZ").replace(tzinfo=UTC)


def _is_pkcs_12(content: bytes) -> bool:
    """Return whether a file is one of PKCS #12, which begins like DER of other kinds."""
    try:
        ((_, inner), *_) = _elements(content)
        return next(_elements(inner)) == (_INTEGER, bytes([_PKCS_12]))
    except (IndexError, StopIteration, ValueError):
        return False


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
        problem = f"cannot read {path}: {error.strerror}"
        step = _NEXT_STEPS.get(error.errno or 0, "check the file")
        raise TlsFileError(name, f"{problem}; {step}") from error
    marks = [mark for mark in _KINDS if f"{mark}-----".encode() in content]
    is_locked = "ENCRYPTED PRIVATE KEY" in marks or b"Proc-Type: 4,ENCRYPTED" in content
    if kind == "PRIVATE KEY" and is_locked:
        raise TlsFileError(
            name,
            f"{path}: expected a private key without a password; remove the password with "
            f"`openssl pkey -in {path} -out NEW`",
        )
    if kind in marks and marks[0] != "OPENSSH PRIVATE KEY":
        return
    if marks:
        found, step = _KINDS[marks[0]], "give the file of the right kind"
    elif not content.strip():
        found, step = "an empty file", "write it again"
    elif content.startswith(_UTF_16):
        found, step = "text in UTF-16", "save it as UTF-8"
    elif _is_pkcs_12(content):
        part = "-nocerts -nodes" if kind == "PRIVATE KEY" else "-nokeys"
        found = "PKCS #12"
        step = f"take it out with `openssl pkcs12 -in {path} {part} -out NEW`"
    elif content.startswith(_DER):
        tool = {"CERTIFICATE": "x509", "PRIVATE KEY": "pkey", "X509 CRL": "crl"}[kind]
        found, step = "DER", f"convert it with `openssl {tool} -inform DER -in {path} -out NEW`"
    else:
        found, step = "no PEM", "give a file with a line -----BEGIN ...-----"
    raise TlsFileError(name, f"{path}: expected {_KINDS[kind]} in PEM, found {found}; {step}")
