"""The loopback driver: a simulated device without hardware."""

from __future__ import annotations

from orientd_loopback.driver import LoopbackDriver
from orientd_loopback.recording import read_recording
