"""The loopback driver: a device that is not there."""

from orientd_loopback.driver import LoopbackDriver
from orientd_loopback.recording import read_recording

__all__ = ["LoopbackDriver", "read_recording"]
