"""Takes a fast status packet apart, as who asked for it does."""

from collections.abc import Sequence

from emulated_dynamixel.packet import crc16


def fast_blocks(packet: bytes, counts: Sequence[int]) -> list[tuple[int, int, bytes]]:
    """Take a fast status packet apart, checking each CRC in it.

    Args:
        packet: the whole packet from its header on.
        counts: how many bytes of content each servo was asked for.

    Returns:
        ``(error, id, content)`` of each servo.

    Raises:
        ValueError: the packet has another length, or a CRC does not agree.
    """
    expected = 8 + sum(counts) + 4 * len(counts)
    if len(packet) != expected:
        raise ValueError(f"a fast status must have {expected} bytes, got {len(packet)}")
    blocks = []
    at = 8
    for count in counts:
        end = at + 2 + count
        if crc16(packet[:end]) != int.from_bytes(packet[end : end + 2], "little"):
            raise ValueError(f"the CRC of the block at byte {at} does not agree")
        blocks.append((packet[at], packet[at + 1], packet[at + 2 : end]))
        at = end + 2
    return blocks
