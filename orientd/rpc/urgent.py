"""One unary call over the daemon's Unix socket, before gRPC's library is loaded.

Loading that library takes longer than all the rest of bringing a device to rest from a shell.  A
call without it is a few frames of HTTP/2 (RFC 9113), with gRPC's own conventions in them ("gRPC
over HTTP2", PROTOCOL-HTTP2.md): sent at once, before the daemon has said anything.

Only the plain answer is understood here.  Whatever else comes back, or does not, whoever asks is to
ask again with the library, which has words for it; so this is for calls that may be made twice.
"""

from __future__ import annotations

import socket
import struct

TIMEOUT = 5.0
"""How long the daemon may take to send the next part of its answer, s."""

_HEAD = struct.Struct(">HBBBL")  # length, in two parts; type; flags; stream
_DATA, _HEADERS, _SETTINGS, _PING, _WINDOW_UPDATE = 0, 1, 4, 6, 8
_HANDLED = (_DATA, _HEADERS, _SETTINGS, _PING, _WINDOW_UPDATE)
_END_STREAM, _ACK, _END_HEADERS, _PADDED = 1, 1, 4, 8
_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
_STREAM = 1
_LARGEST_WINDOW = 2**31 - 1
_FIRST_WINDOW = 2**16 - 1
_INITIAL_WINDOW_SIZE = 4  # the number of that setting
_MESSAGE = struct.Struct(">BL")  # whether it is compressed; length

# RFC 7541, appendix A: entries of the static table, alone or as the name before a literal value.
_POST, _HTTP = b"\x83", b"\x86"
_AUTHORITY, _PATH, _CONTENT_TYPE, _NEW_NAME = b"\x01", b"\x04", b"\x0f\x10", b"\x00"
_DONE = b"\x0bgrpc-status\x010"
"""How gRPC's server spells the status OK among the trailers: a literal, not in Huffman's code."""


def text_fields(*fields: str) -> bytes:
    """Return the message whose fields 1, 2, ... are *fields*, each of at most 126 bytes of UTF-8.

    >>> text_fields("arm", "").hex()
    '0a0361726d'
    """
    message = b""
    for number, field in enumerate(fields, start=1):
        if field:
            message += bytes((number << 3 | 2,)) + _literal(field.encode())
    return message


def begin_call(
    path: str, method: str, message: bytes, *, timeout: float = TIMEOUT
) -> socket.socket | None:
    """Send *message* and return the connection that the answer comes by, if it was sent.

    Args:
        path: of the Unix socket.
        method: ``package.Service/Method``.
        message: as it is serialised.
        timeout: how long the next part of the answer may take, s.
    """
    headers = (
        _POST
        + _HTTP
        + (_PATH + _literal(f"/{method}".encode()))
        + (_AUTHORITY + _literal(b"localhost"))
        + (_CONTENT_TYPE + _literal(b"application/grpc"))
        + (_NEW_NAME + _literal(b"te") + _literal(b"trailers"))
    )
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(timeout)
    try:
        connection.connect(path)
        connection.sendall(
            _PREFACE
            + _frame(_SETTINGS, 0, 0, struct.pack(">HL", _INITIAL_WINDOW_SIZE, _LARGEST_WINDOW))
            + _frame(_WINDOW_UPDATE, 0, 0, struct.pack(">L", _LARGEST_WINDOW - _FIRST_WINDOW))
            + _frame(_HEADERS, _END_HEADERS, _STREAM, headers)
            + _frame(_DATA, _END_STREAM, _STREAM, _MESSAGE.pack(0, len(message)) + message)
        )
    except OSError:
        connection.close()
        return None
    return connection


def read_answer(connection: socket.socket) -> bytes | None:
    """Return the message that answers the call, or ``None`` where something else came; hang up."""
    with connection:
        try:
            return _answer(connection)
        except OSError:
            return None


def _answer(connection: socket.socket) -> bytes | None:
    body = b""
    with connection.makefile("rb") as incoming:
        while True:
            head = incoming.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return None
            high, low, kind, flags, stream = _HEAD.unpack(head)
            payload = incoming.read(high << 8 | low)
            if kind not in _HANDLED or (flags & _PADDED and kind in (_DATA, _HEADERS)):
                return None
            if kind in (_SETTINGS, _PING) and not flags & _ACK:
                connection.sendall(_frame(kind, _ACK, 0, payload if kind == _PING else b""))
            elif stream == _STREAM and kind == _DATA:
                body += payload
            if stream == _STREAM and flags & _END_STREAM and kind in (_DATA, _HEADERS):
                is_done = kind == _HEADERS and flags & _END_HEADERS and _DONE in payload
                return _unpacked(body) if is_done else None


def _unpacked(body: bytes) -> bytes | None:
    """Return the one message in *body*."""
    if len(body) < _MESSAGE.size:
        return None
    is_compressed, size = _MESSAGE.unpack_from(body)
    message = body[_MESSAGE.size :]
    return message if size == len(message) and not is_compressed else None


def _frame(kind: int, flags: int, stream: int, payload: bytes) -> bytes:
    size = len(payload)
    return _HEAD.pack(size >> 8, size & 0xFF, kind, flags, stream) + payload


def _literal(text: bytes) -> bytes:
    """Return *text* with its length before it, which HPACK and protobuf write alike up to 127."""
    if len(text) > 126:
        raise ValueError(f"expected at most 126 bytes, got {len(text)}")
    return bytes((len(text),)) + text
