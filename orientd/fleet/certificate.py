"""The name in a certificate, read from its file."""

from __future__ import annotations

import ssl
from pathlib import Path

from orientd.bounded_file import MEBIBYTE, read_bounded
from orientd.der import elements
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
        signed = next(elements(next(elements(whole))[1]))[1]
        subject = list(elements(signed))[_SUBJECT][1]
        for _, group in elements(subject):
            (_, kind), (_, value) = elements(next(elements(group))[1])
            if kind == _COMMON_NAME:
                return value.decode()
    except OSError as error:
        raise DaemonError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, IndexError, StopIteration) as error:
        raise DaemonError(f"{path} is no certificate") from error
    raise DaemonError(f"the certificate {path} has no common name")
