"""Packages of RTDE, made by hand."""

import struct


def package(kind, payload=b""):
    return struct.pack(">HB", 3 + len(payload), ord(kind)) + payload
