"""Why a daemon cannot be reached over TCP: gRPC says that it is unavailable, and no more."""

from __future__ import annotations

import socket
import ssl
from collections.abc import Mapping
from pathlib import Path

TIMEOUT = 2.0
"""How long each step of trying it once more may take, s."""

_VERIFY: Mapping[int, str] = {
    9: "is not valid yet",
    10: "has expired",
    **dict.fromkeys((18, 19, 20, 21), "is signed by another authority than --ca"),
    62: "is for another name",
    64: "is for another address",
}
"""By the codes of OpenSSL (X509_V_ERR_...): what is wrong with the certificate of the daemon."""

_ALERTS: Mapping[str, str] = {
    "UNKNOWN_CA": "is signed by another authority",
    "CERTIFICATE_REVOKED": "is revoked",
    "CERTIFICATE_EXPIRED": "has expired",
    "UNSUPPORTED_CERTIFICATE": "is not one for clients (extended key usage)",
    "CERTIFICATE_REQUIRED": "is missing",
    "BAD_CERTIFICATE": "is not accepted",
    "CERTIFICATE_UNKNOWN": "is not accepted",
    "DECRYPT_ERROR": "is signed by another authority",
}
"""By the name of a TLS alert (RFC 8446, section 6): what is wrong with the client's certificate."""


def tls_problem(address: str, certificate: Path, key: Path, ca: Path) -> str:
    """Return why no call gets through to the daemon at *address*; empty where one would.

    Args:
        address: ``HOST:PORT``.
        certificate: of the client, a file.
        key: of that certificate, a file.
        ca: what the daemon's certificate is signed with, a file.
    """
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    try:
        context = ssl.create_default_context(cafile=str(ca))
        context.load_cert_chain(certificate, key)
        context.set_alpn_protocols(["h2"])
    except (OSError, ValueError) as error:
        return f"the certificates cannot be used: {error}"
    try:
        plain = socket.create_connection((host, int(port)), timeout=TIMEOUT)
    except (OSError, ValueError) as error:
        return f"no daemon listens at {address}: {getattr(error, 'strerror', None) or error}"
    with plain:
        try:
            with context.wrap_socket(plain, server_hostname=host) as secured:
                # Of the client's certificate the daemon says what it thinks afterwards.
                is_over = not secured.recv(1)
        except ssl.SSLCertVerificationError as error:
            what = _VERIFY.get(error.verify_code, f"is refused: {error.verify_message}")
            return f"the certificate of the daemon at {address} {what}"
        except ssl.SSLEOFError:
            is_over = True
        except ssl.SSLError as error:
            reason = error.reason or str(error)
            told = next((text for name, text in _ALERTS.items() if reason.endswith(name)), "")
            if told:
                return f"the daemon at {address} refuses this certificate: it {told}"
            return f"what listens at {address} is no daemon with TLS 1.3: {reason}"
        except TimeoutError:
            is_over = False
        except OSError:
            is_over = True
    if not is_over:
        return ""
    return (
        f"the daemon at {address} does not admit this certificate: it has no role there, is not "
        "one for clients (extended key usage), or its serial number is revoked"
    )
