"""The loopback driver: a device that is not there."""

from __future__ import annotations

from orientd_loopback.driver import LoopbackDriver
from orientd_loopback.recording import read_recording
