"""Refused connections are written at once, and repeated ones together."""

import asyncio

import pytest

from orientd.daemon.access import refusals as module
from orientd.daemon.access.refusals import MOST_HOSTS, Refusals


class Written(list):
    def record(self, **fields):
        self.append(fields)


@pytest.fixture
def spacing(monkeypatch):
    monkeypatch.setattr(module, "SPACING", 0.05)


def written_of(*origins, wait=0.0):
    """Return what is written of refusals that come at once, and those at the end."""
    written = Written()

    async def test():
        refusals = Refusals(written)
        for origin in origins:
            refusals.note(origin, "no role")
        await asyncio.sleep(wait)
        before = [dict(one) for one in written]
        refusals.close()
        return before

    return asyncio.run(test()), written


def test_a_thousand_refusals_of_one_host_are_two_lines():
    now, later = written_of(*[f"tcp, 10.0.0.9:{port}" for port in range(1000)])
    first = {"event": "refused", "origin": "tcp, 10.0.0.9:0", "text": "no role"}
    assert now == [first]
    assert later == [
        first,
        {"event": "refused", "origin": "tcp, 10.0.0.9", "text": "no role", "times": 999},
    ]


def test_counted_refusals_are_written_after_a_while(spacing):
    now, _ = written_of("unix, process 7", "unix, process 8", "unix, process 9", wait=0.2)
    assert [one.get("times") for one in now] == [None, 2]
    assert now[1]["origin"] == "unix"


def test_each_host_has_a_line_of_its_own():
    now, _ = written_of("tcp, 10.0.0.9:1", "tcp, 10.0.0.8:1")
    assert [one["origin"] for one in now] == ["tcp, 10.0.0.9:1", "tcp, 10.0.0.8:1"]


def test_many_hosts_are_counted_together():
    now, later = written_of(*[f"tcp, 10.0.{k // 250}.{k % 250}:1" for k in range(3 * MOST_HOSTS)])
    assert len(now) <= MOST_HOSTS + 1
    assert sum(one.get("times", 1) for one in later) == 3 * MOST_HOSTS
