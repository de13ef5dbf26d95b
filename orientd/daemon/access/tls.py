"""TLS 1.3 with certificates on both sides: what the daemon asks of whoever comes over TCP."""

from __future__ import annotations

import asyncio
import socket
import ssl
from typing import Any

from orientd.config import TcpSettings
from orientd.daemon.access.identity import ClientCertificate
from orientd.der import elements
from orientd.errors import ConfigError


class _Handshake(ssl.SSLObject):
    """A handshake whose failure brings the alert that tells the other end of it.

    asyncio hangs up without sending that, and whoever is refused would not know why.
    """

    outgoing: ssl.MemoryBIO

    def do_handshake(self) -> None:
        """Do the handshake; an error of it has the bytes to send in its attribute ``alert``."""
        try:
            super().do_handshake()
        except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
            raise
        except ssl.SSLError as error:
            error.alert = self.outgoing.read()  # type: ignore[attr-defined] # as is said above
            raise


class _Context(ssl.SSLContext):
    def wrap_bio(
        self,
        incoming: ssl.MemoryBIO,
        outgoing: ssl.MemoryBIO,
        *rest: Any,  # noqa: ANN401 - as in the library
        **more: Any,  # noqa: ANN401
    ) -> Any:  # noqa: ANN401
        made = super().wrap_bio(incoming, outgoing, *rest, **more)
        if isinstance(made, _Handshake):
            made.outgoing = outgoing
        return made


def server_context(settings: TcpSettings) -> ssl.SSLContext:
    """Return what to speak TLS with.

    A client without a certificate of the CA, or with one that is out of date or on the revocation
    list, does not get past the handshake.

    Raises:
        ConfigError: a file of *settings* cannot be read or does not fit.
    """
    context = _Context(ssl.PROTOCOL_TLS_SERVER)
    context.sslobject_class = _Handshake
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.verify_mode = ssl.CERT_REQUIRED
    context.set_alpn_protocols(["h2"])
    # A session that is taken up again would not be checked against a newer revocation list.
    context.num_tickets = 0
    name, path = "certificate", settings.certificate
    try:
        context.load_cert_chain(settings.certificate, settings.key)
        name, path = "ca", settings.ca
        context.load_verify_locations(settings.ca)
        if settings.crl is not None:
            name, path = "crl", settings.crl
            context.load_verify_locations(settings.crl)
            context.verify_flags |= ssl.VerifyFlags.VERIFY_CRL_CHECK_LEAF
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(f"tcp.{name}: cannot use {path}: {error}") from error
    return context


async def until_spoken(peer: socket.socket) -> None:
    """Wait until something has come from *peer*, or it has hung up; it is left to be read."""
    loop, heard = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(peer, heard.set)
    try:
        await heard.wait()
    finally:
        loop.remove_reader(peer)


def peer_certificate(transport: ssl.SSLObject) -> ClientCertificate:
    """Return the certificate at the other end, which has been verified.

    Raises:
        ValueError: it has not exactly one common name, or is not one for clients.
    """
    if not _is_for_clients(transport.getpeercert(binary_form=True) or b""):
        raise ValueError("the certificate is not one for clients (extended key usage clientAuth)")
    found: dict[str, Any] = dict(transport.getpeercert() or {})
    fields = [pair for part in found.get("subject", ()) for pair in part]
    names = [value for key, value in fields if key == "commonName"]
    if len(names) != 1:
        raise ValueError(f"expected one common name, got {len(names)}")
    return ClientCertificate(
        name=str(names[0]),
        serial=str(found["serialNumber"]).upper().lstrip("0"),
        expires=ssl.cert_time_to_seconds(str(found["notAfter"])),
    )


_EXTENDED_KEY_USAGE = bytes.fromhex("551d25")
_CLIENT_AUTH = bytes.fromhex("2b06010505070302")
_EXTENSIONS = 0xA3


def _is_for_clients(certificate: bytes) -> bool:
    """Whether a certificate has the extended key usage clientAuth (RFC 5280, 4.2.1.12).

    OpenSSL refuses one whose usages are others, but lets one pass that has none.

    Args:
        certificate: DER, well formed: it has been verified.
    """
    (whole,) = [inner for _, inner in elements(certificate)]
    signed = next(elements(whole))[1]
    for tag, inner in elements(signed):
        if tag != _EXTENSIONS:
            continue
        for _, extension in elements(next(elements(inner))[1]):
            (_, name), *_, (_, content) = elements(extension)
            if name == _EXTENDED_KEY_USAGE:
                usages = next(elements(content))[1]
                return any(usage == _CLIENT_AUTH for _, usage in elements(usages))
    return False
