"""Refused connections in the log and the audit log; repeated ones are written together.

The first refusal of a host for one reason is written at once.  Later ones are counted, and written
once in :data:`SPACING` seconds.  So a program that tries again and again fills no disk.
"""

from __future__ import annotations

import asyncio
import logging

from orientd.daemon.access.audit import AuditLog

_log = logging.getLogger(__name__)

SPACING = 10.0
"""Least time between two lines about refusals of a host for one reason, s."""

MOST_HOSTS = 100
"""Pairs of a host and a reason that are counted apart; further ones are counted together."""


class Refusals:
    """Write refused connections; use it in the event loop."""

    def __init__(self, audit: AuditLog) -> None:
        """Write to *audit*, and to the log."""
        self._audit = audit
        self._counts: dict[tuple[str, str], int] = {}

    def note(self, origin: str, problem: str) -> None:
        """Write a refusal, or count it if there was one of the kind a short time ago.

        Args:
            origin: address of the other end, for people.
            problem: the reason.
        """
        host = origin.rpartition(":")[0] or origin.partition(",")[0]
        kind = host, problem
        if kind not in self._counts and len(self._counts) >= MOST_HOSTS:
            kind = "several hosts", "refused"
        if kind in self._counts:
            self._counts[kind] += 1
            return
        self._write(origin, problem, {})
        self._count(kind)

    def close(self) -> None:
        """Write what is counted."""
        for host, problem in list(self._counts):
            self._write_counted((host, problem))

    def _count(self, kind: tuple[str, str]) -> None:
        self._counts[kind] = 0
        asyncio.get_running_loop().call_later(SPACING, self._report, kind)

    def _report(self, kind: tuple[str, str]) -> None:
        if self._write_counted(kind):
            self._count(kind)

    def _write_counted(self, kind: tuple[str, str]) -> int:
        """Write the refusals of a kind that are counted, and return their number."""
        times = self._counts.pop(kind, 0)
        if times:
            self._write(*kind, {"times": times})
        return times

    def _write(self, origin: str, problem: str, times: dict[str, int]) -> None:
        again = f", {times['times']} more times" if times else ""
        _log.warning("refused %s: %s%s", origin, problem, again)
        self._audit.record(event="refused", origin=origin, text=problem, **times)
