"""Elements of DER, the bytes that a certificate is made of."""

from __future__ import annotations

from collections.abc import Iterator


def elements(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield tag and content of each element (X.690, 8.1).

    Raises:
        IndexError: *content* ends where a length should be.
    """
    begin = 0
    while begin < len(content):
        tag, length = content[begin], content[begin + 1]
        begin += 2
        if length & 0x80:
            count = length & 0x7F
            length = int.from_bytes(content[begin : begin + count], "big")
            begin += count
        yield tag, content[begin : begin + length]
        begin += length
