"""Whose page it is: a browser lets any web page open a connection to this machine."""

from __future__ import annotations

from collections.abc import Mapping
from ipaddress import ip_address
from urllib.parse import urlsplit

_HTTP = 80


def is_own_page(headers: Mapping[str, str], *, is_local: bool, port: int | None = None) -> bool:
    """Return whether a connection comes from a page that was served here, or from no browser.

    Args:
        headers: of the request.
        is_local: whether pages are served to this machine only: then under its own names only, as
            the name of another machine can be made to mean this one.
        port: that pages are served at; by default the one that was asked.
    """
    origin, host = headers.get("Origin"), urlsplit(f"//{headers.get('Host', '')}")
    if is_local and not is_loopback(host.hostname or ""):
        return False
    if origin is None:
        return True
    try:
        page = urlsplit(origin)
        asked = host.hostname, port or host.port or _HTTP
        return bool(page.netloc) and (page.hostname, page.port or _HTTP) == asked
    except ValueError:
        return False


def is_loopback(host: str) -> bool:
    """Return whether *host* is a name or an address of this machine for itself.

    >>> is_loopback("localhost"), is_loopback("127.0.0.1"), is_loopback("192.0.2.1")
    (True, True, False)
    """
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False
