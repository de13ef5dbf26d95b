"""What the driver says of its device beside the cycles: notices once it is open, its health."""

from __future__ import annotations

from orientd.driver import Driver
from orientd.stream import NoteKind, SharedMemory, pack_note, publish_health

_INTERVAL_NS = 1_000_000_000


class DeviceTeller:
    """Hand notices and health on to the daemon."""

    def __init__(self, driver: Driver, memory: SharedMemory, period_ns: int) -> None:
        """Say what *driver* says, in the rings of *memory*, with cycles of *period_ns*."""
        self._driver = driver
        self._memory = memory
        self._every = max(1, _INTERVAL_NS // period_ns)
        self._told: tuple[str, ...] = ()
        self._hindered = -self._every - 1

    def tell_notices(self) -> None:
        """Say what there is to say of a device that was opened, or reset."""
        self._told = ()
        self._tell_new()

    def _tell_new(self) -> None:
        notices = tuple(self._driver.notices())
        for text in notices:
            if text not in self._told:
                self._memory.notes.publish(*pack_note(0, NoteKind.NOTICE, 0, text))
        self._told = notices

    def tell_health(self, cycle: int) -> None:
        """Say once a second what is new and how the device's parts are; called every *cycle*."""
        if cycle % self._every == 0:
            self._tell_new()
            parts = self._driver.health()
            if parts:
                publish_health(self._memory.health, parts)

    def tell_hindrance(self, text: str, cycle: int) -> None:
        """Say why targets are not followed as they come; once until they have been for a second."""
        if cycle - self._hindered > self._every:
            words = f"targets are followed more slowly, or not to their end: {text}"
            self._memory.notes.publish(*pack_note(0, NoteKind.NOTICE, 0, words))
        self._hindered = cycle
