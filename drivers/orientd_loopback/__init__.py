"""The loopback driver: a device that is not there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd_loopback.driver import LoopbackDriver
    from orientd_loopback.recording import read_recording

__getattr__ = lazily(__name__)
