"""Why a daemon cannot be reached over TCP: gRPC says that it is unavailable, and no more."""

from __future__ import annotations

import contextlib
import socket
import ssl
from collections.abc import Mapping
from pathlib import Path
from typing import Any

TIMEOUT = 2.0
"""How long each step of trying it once more may take, s."""

_VERIFY: Mapping[int, str] = {
    9: "is not valid yet",
    10: "has expired",
    **dict.fromkeys((18, 19, 20, 21), "is signed by another authority than --ca"),
    26: "is not one for clients (extended key usage)",
    62: "is for another name",
    64: "is for another address",
}
"""By the codes of OpenSSL (X509_V_ERR_...): what is wrong with a certificate."""


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
                # The daemon looks at the client's certificate afterwards, and hangs up, or speaks.
                is_over = not secured.recv(1)
        except ssl.SSLCertVerificationError as error:
            return f"the certificate of the daemon at {address} {_what(error)}"
        except TimeoutError:
            is_over = False
        except (ssl.SSLEOFError, ConnectionError):
            is_over = True
        except ssl.SSLError as error:
            reason = error.reason or str(error)
            if "ALERT" not in reason:
                return f"what listens at {address} is no daemon with TLS 1.3: {reason}"
            is_over = True
        except OSError:
            is_over = True
    if not is_over:
        return ""
    try:
        verified(certificate, key, ca)
    except ssl.SSLCertVerificationError as error:
        return f"the daemon at {address} refuses this certificate: it {_what(error)}"
    return (
        f"the daemon at {address} does not admit this certificate: it has no role there, or is "
        "revoked; its log says which"
    )


def verified(certificate: Path, key: Path, ca: Path) -> Mapping[str, Any]:
    """Return a client's certificate as a daemon that trusts *ca* sees it; see ``getpeercert``.

    A handshake in memory verifies it.  The daemon's own verdict is lost when it hangs up.

    Args:
        certificate: of the client, a file.
        key: of that certificate, a file.
        ca: what the daemon trusts, a file.

    Raises:
        ssl.SSLCertVerificationError: the daemon would refuse it.
        OSError: a file cannot be read, or does not fit.
    """
    daemon, client = map(ssl.SSLContext, (ssl.PROTOCOL_TLS_SERVER, ssl.PROTOCOL_TLS_CLIENT))
    daemon.verify_mode = ssl.CERT_REQUIRED
    daemon.load_verify_locations(ca)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    for context in (daemon, client):
        context.load_cert_chain(certificate, key)
    to_daemon, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = client.wrap_bio(to_client, to_daemon)
    theirs = daemon.wrap_bio(to_daemon, to_client, server_side=True)
    for end in (ours, theirs, ours, theirs):
        with contextlib.suppress(ssl.SSLWantReadError):
            end.do_handshake()
    return dict(theirs.getpeercert() or {})


def _what(error: ssl.SSLCertVerificationError) -> str:
    return _VERIFY.get(error.verify_code, f"is refused: {error.verify_message}")
