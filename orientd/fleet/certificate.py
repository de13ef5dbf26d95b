"""The name in a certificate, read from its file."""

from __future__ import annotations

import ssl
from collections.abc import Iterator
from pathlib import Path

from orientd.bounded_file import MEBIBYTE, read_bounded
from orientd.errors import DaemonError

_COMMON_NAME = bytes.fromhex("550403")
_SUBJECT = 5
"""Place of the subject in what is signed (RFC 5280, 4.1), the version before the rest."""


def common_name(path: Path) -> str:
    """Return the common name of the first certificate in a PEM file.

    Raises:
        DaemonError: the file cannot be read, or has no such name.
    """
    try:
        text = read_bounded(path, MEBIBYTE).decode("ascii")
        begin = text.index("-----BEGIN CERTIFICATE-----")
        end = text.index("-----END CERTIFICATE-----", begin)
        whole = ssl.PEM_cert_to_DER_cert(text[begin:end] + "-----END CERTIFICATE-----\n")
        signed = next(_parts(next(_parts(whole))))
        subject = list(_parts(signed))[_SUBJECT]
        for group in _parts(subject):
            kind, value = _parts(next(_parts(group)))
            if kind == _COMMON_NAME:
                return value.decode()
    except OSError as error:
        raise DaemonError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, IndexError, StopIteration) as error:
        raise DaemonError(f"{path} is no certificate") from error
    raise DaemonError(f"the certificate {path} has no common name")


def _parts(content: bytes) -> Iterator[bytes]:
    """Yield the content of each element of DER (X.690, 8.1)."""
    begin = 0
    while begin < len(content):
        length = content[begin + 1]
        begin += 2
        if length & 0x80:
            count = length & 0x7F
            length = int.from_bytes(content[begin : begin + count], "big")
            begin += count
        yield content[begin : begin + length]
        begin += length
