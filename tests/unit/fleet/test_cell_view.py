"""The page of a cell: where its devices stand, what is known of them, and its one command."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest

from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import STALE
from orientd.protocol.values import quaternion
from orientd_fleet.cell_view import CellView, lines
from orientd_fleet.overview import Member

pytest.importorskip("websockets")

DEVICE = pb.DeviceReport(
    name="arm", driver="loopback", rate_hz=500.0, state=pb.STATE_HOLDING, speed=1.0
)


def changed(message, **fields):
    """Return a copy of *message* with other *fields*."""
    copy = type(message).FromString(message.SerializeToString())
    copy.MergeFrom(type(message)(**fields))
    return copy


TURNED = changed(DEVICE, cycle=pb.Cycle(q=quaternion((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))))


class Cell:
    """Daemons that do not change, and the stops that were asked for."""

    def __init__(self, *members):
        self._members, self.stops, self.problem = members, [], ""

    def members(self):
        return self._members

    def stop(self, *, is_quickest):
        self.stops.append(is_quickest)
        return self.problem


@pytest.fixture
def view_of():
    opened = []

    def make(cell):
        view = CellView(cell, host="127.0.0.1", port=0, is_dark=True)
        closing = threading.Event()
        runs = threading.Thread(target=view.run, args=(closing,))
        runs.start()
        opened.append((closing, runs))
        return view

    yield make
    for closing, runs in opened:
        closing.set()
        runs.join()


def member(name, count, age=0.1):
    devices = [changed(TURNED, name=f"arm-{k}") for k in range(count)]
    return Member(name, is_alive=True, age=age, devices=devices)


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (3, 3), (4, 4), (5, 3), (10, 4)])
def test_devices_stand_in_rows_about_the_middle(view_of, count, columns):
    tools = view_of(Cell(member("left", count))).picture({})["tools"]
    places = np.array([tool["at"] for tool in tools])
    apart = np.linalg.norm(places[:, None] - places, axis=-1)[~np.eye(count, dtype=bool)]
    assert len(set(places[:, 1])) == columns
    assert apart.min(initial=0.9) == pytest.approx(0.9)
    assert np.ptp(places[:, 2]) == 0.0
    assert places[:, 1].max() == pytest.approx(-places[:, 1].min())
    assert places[:, 0].max() == pytest.approx(-places[:, 0].min())
    assert [tool["name"] for tool in tools] == [f"left/arm-{k}" for k in range(count)]


def test_only_a_device_that_is_known_has_axes(view_of):
    cell = Cell(
        member("known", 1),
        member("old", 1, age=STALE + 0.1),
        Member("gone", is_alive=False, age=0.1, devices=[TURNED]),
        Member("still", is_alive=True, age=0.1, devices=[changed(TURNED, is_stale=True)]),
        Member("new", is_alive=True, age=0.1, devices=[DEVICE]),
    )
    picture = view_of(cell).picture({})
    assert [tool["q"] is None for tool in picture["tools"]] == [False, True, True, True, True]
    assert [tool["problem"] for tool in picture["tools"]] == [False, True, True, True, True]
    assert picture["tools"][0]["q"] == pytest.approx((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    assert (picture["dark"], picture["control"], picture["age"]) == (True, None, 0.0)


def test_a_page_stops_and_halts_and_is_told_what_did_not_answer(view_of):
    cell = Cell(member("left", 1))
    view = view_of(cell)
    for what in ("stop", "halt", "pause"):
        view.do({"do": what})
    assert cell.stops == [False, True]
    cell.problem = "left: no answer"
    with pytest.raises(OrientdError, match="not acknowledged: left: no answer"):
        view.do({"do": "stop"})


def test_a_daemon_of_a_cell_that_is_gone_or_silent_is_not_told_as_it_was():
    def cell(one):
        return [" ".join(line[1:]) for line in lines([one])]

    member = Member("arm-1", is_alive=True, age=0.1, age_bound=0.001, devices=[DEVICE])
    assert "arm: ● Holding at rest, ready to move" in cell(member)
    for one in (replace(member, is_alive=False), replace(member, age=STALE + 0.1)):
        texts = cell(one)
        assert "arm: ? Unknown holding when last heard of" in texts
        assert not any("ready" in line for line in texts)
    assert "✕ Out of date arm says nothing" in cell(Member("arm", is_alive=True))


def test_an_age_says_how_far_it_may_be_wrong():
    def age(**more):
        return lines([Member("arm", is_alive=True, **more)])[0][2]

    assert age() == ""
    assert age(age=0.2, age_bound=0.05) == "less than 0.3 s old"
    assert age(age=0.8, age_bound=0.05) == "0.8 s old"
    assert age(age=0.8, age_bound=0.4) == "0.8 s old (±0.4 s)"
