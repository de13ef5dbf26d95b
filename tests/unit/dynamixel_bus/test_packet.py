"""The packet layer against the examples that ROBOTIS published."""

import random

import pytest

from emulated_dynamixel.packet import (
    Damaged,
    Instruction,
    Packet,
    Parser,
    crc16,
    encode,
    fast_part,
    status,
    stuff,
    unstuff,
)

# ROBOTIS e-Manual, DYNAMIXEL Protocol 2.0.  The last one's CRC is that of the printed packet with
# its instruction byte 9A; the manual prints the CRC of the fast sync read example by mistake.
PUBLISHED = {
    "ping": ("FFFFFD00010300 01 194E", Packet(1, 0x01)),
    "ping status": ("FFFFFD00010700 55 00060426 655D", Packet(1, 0x55, b"\0\x06\x04\x26")),
    "broadcast ping": ("FFFFFD00FE0300 01 3142", Packet(0xFE, 0x01)),
    "read": ("FFFFFD00010700 02 84000400 1D15", Packet(1, 0x02, b"\x84\0\x04\0")),
    "read status": ("FFFFFD00010800 55 00A6000000 8CC0", Packet(1, 0x55, b"\0\xa6\0\0\0")),
    "write": ("FFFFFD00010900 03 740000020000 CA89", Packet(1, 0x03, b"\x74\0\0\x02\0\0")),
    "write status": ("FFFFFD00010400 55 00 A10C", Packet(1, 0x55, b"\0")),
    "reg write": ("FFFFFD00010900 04 6800C8000000 AE8E", Packet(1, 4, b"\x68\0\xc8\0\0\0")),
    "action": ("FFFFFD00010300 05 02CE", Packet(1, 0x05)),
    "factory reset": ("FFFFFD00010400 06 01 A1E6", Packet(1, 0x06, b"\x01")),
    "reboot": ("FFFFFD00010300 08 2F4E", Packet(1, 0x08)),
    "clear": ("FFFFFD00010800 10 0144584C22 B1DC", Packet(1, 0x10, bytes.fromhex("0144584C22"))),
    "sync read": ("FFFFFD00FE0900 82 84000400 0102 CEFA", Packet(0xFE, 0x82, b"\x84\0\x04\0\1\2")),
    "sync write": (
        "FFFFFD00FE1100 83 74000400 0196000000 02AA000000 8287",
        Packet(0xFE, 0x83, bytes.fromhex("74000400 0196000000 02AA000000")),
    ),
    "fast sync read": (
        "FFFFFD00FE0A00 8A 84000400 030704 20F2",
        Packet(0xFE, 0x8A, bytes.fromhex("84000400 030704")),
    ),
    "bulk read": (
        "FFFFFD00FE0D00 92 0190000200 0292000100 1A05",
        Packet(0xFE, 0x92, bytes.fromhex("0190000200 0292000100")),
    ),
    "bulk write": (
        "FFFFFD00FE1000 93 0120000200A000 021F00010050 B768",
        Packet(0xFE, 0x93, bytes.fromhex("0120000200A000 021F00010050")),
    ),
}
FAST_STATUS = "FFFFFD00FE1900 55 0003A6000000 8408 00071F080000 16CA 0004FF030000 D19E"
FAST_BLOCKS = [
    (0, 3, bytes.fromhex("A6000000")),
    (0, 7, bytes.fromhex("1F080000")),
    (0, 4, bytes.fromhex("FF030000")),
]


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_packet_is_encoded_to_the_byte(name):
    raw, packet = PUBLISHED[name]
    assert encode(packet) == bytes.fromhex(raw)


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_packet_is_decoded(name):
    raw, packet = PUBLISHED[name]
    octets = bytes.fromhex(raw)
    assert Parser().feed(octets, 0) == [(packet, len(octets))]


def test_published_fast_status_is_encoded_to_the_byte():
    heard = b""
    for place in range(len(FAST_BLOCKS)):
        heard += fast_part(FAST_BLOCKS, place, heard)
    assert heard == bytes.fromhex(FAST_STATUS)


def test_crc_equals_that_of_the_vendors_sdk():
    handler = pytest.importorskip("dynamixel_sdk").Protocol2PacketHandler()
    rng = random.Random(1)
    for _ in range(500):
        octets = rng.randbytes(rng.randrange(1, 80))
        assert crc16(octets) == handler.updateCRC(0, octets, len(octets))


def test_stuffing_is_undone_even_where_headers_crowd():
    rng = random.Random(2)
    for _ in range(2000):
        body = bytes(rng.choice((0xFF, 0xFD, 0x00)) for _ in range(rng.randrange(0, 24)))
        stuffed = stuff(body)
        assert unstuff(stuffed) == body
        assert b"\xff\xff\xfd\x00" not in stuffed


def test_stuffed_packet_counts_its_stuffing():
    raw = encode(Packet(1, Instruction.WRITE, b"\x74\0\xff\xff\xfd\xff"))
    assert raw[5] == 3 + 6 + 1
    assert Parser().feed(raw, 0)[0][0] == Packet(1, 3, b"\x74\0\xff\xff\xfd\xff")


def test_packets_are_found_byte_by_byte_between_rubbish():
    raw = b"\x00\xff\xff" + encode(Packet(1, 1)) + b"\xff\xff\xfd" + status(2, 0, b"\xff\xff\xfd")
    parser = Parser()
    found = [packet for octet in raw for packet, _ in parser.feed(bytes([octet]), 0)]
    assert found == [Packet(1, 1), Packet(2, 0x55, b"\0\xff\xff\xfd")]


def test_damaged_packet_is_reported_and_the_next_one_found():
    raw = bytearray(encode(Packet(1, 3, b"\x74\0\1\0\0\0")))
    raw[10] ^= 1
    found = Parser().feed(bytes(raw) + encode(Packet(2, 1)), 0)
    assert [packet for packet, _ in found] == [Damaged(1, 3), Packet(2, 1)]


def test_damaged_length_does_not_swallow_what_follows_for_ever():
    raw = bytearray(encode(Packet(1, 1)))
    raw[5] = 20
    stream = bytes(raw) + encode(Packet(2, 1)) * 3
    assert Packet(2, 1) in [packet for packet, _ in Parser().feed(stream, 0)]


def test_pause_inside_a_packet_drops_its_beginning():
    raw = encode(Packet(1, 1))
    parser = Parser(gap_ns=1_500_000)
    parser.feed(raw[:5], 0)
    assert parser.feed(raw[5:], 1_500_001) == []
    parser.feed(raw[:5], 10_000_000)
    assert parser.feed(raw[5:], 11_000_000)[0][0] == Packet(1, 1)
