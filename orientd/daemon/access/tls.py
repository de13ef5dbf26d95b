"""TLS 1.3 with certificates on both sides: what the daemon asks of clients over TCP."""

from __future__ import annotations

import asyncio
import ssl
from typing import Any

from orientd.config import TcpSettings, TlsFileError, check_tls_files
from orientd.daemon.access.identity import ClientCertificate
from orientd.errors import ConfigError


def server_context(settings: TcpSettings) -> ssl.SSLContext:
    """Return what to speak TLS with.

    OpenSSL refuses a client without a certificate of the CA, or with one that has expired, is on
    the revocation list, or is for another purpose.

    Raises:
        ConfigError: a file of *settings* cannot be read or does not fit.
    """
    try:
        check_tls_files(settings.certificate, settings.key, settings.ca, settings.crl)
    except TlsFileError as error:
        raise ConfigError(f"tcp.{error.name}: {error}") from error
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.verify_mode = ssl.CERT_REQUIRED
    context.set_alpn_protocols(["h2"])
    # A resumed session would not be checked against a newer revocation list.
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


def peer_certificate(transport: asyncio.BaseTransport) -> ClientCertificate:
    """Return the certificate at the other end, which OpenSSL has verified.

    Raises:
        ValueError: it has not exactly one common name.
    """
    found: dict[str, Any] = transport.get_extra_info("peercert") or {}
    fields = [pair for part in found.get("subject", ()) for pair in part]
    names = [value for key, value in fields if key == "commonName"]
    if len(names) != 1:
        raise ValueError(f"expected one common name, got {len(names)}")
    return ClientCertificate(
        name=str(names[0]),
        serial=str(found["serialNumber"]).upper().lstrip("0"),
        expires=ssl.cert_time_to_seconds(str(found["notAfter"])),
    )
