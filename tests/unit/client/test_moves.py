"""The motions that a client keeps, to stop them at its end."""

import threading
from contextlib import nullcontext
from types import SimpleNamespace

import orientd
from orientd.client import move_handle
from orientd.client.channel import Way
from orientd.client.robot import Robot


def test_motions_that_two_threads_begin_are_both_stopped_at_the_end(tmp_path, monkeypatch):
    robot, other, abandoned = Robot(Way(tmp_path / "none.sock")), [], []

    def move(name):
        names.append(name)
        robot.move([orientd.Quaternion(w=1.0, x=0.0, y=0.0, z=0.0)])

    class Handle:
        """A motion; the look at the first one lets another thread begin a motion."""

        lease = None

        def __init__(self, *_, **__):
            self.name = names.pop()

        @property
        def is_done(self):
            if self.name == "first" and not other:
                other.append(threading.Thread(target=move, args=("other",)))
                other[0].start()
                other[0].join(0.3)
            return False

        def abandon(self):
            abandoned.append(self.name)

    names = []
    monkeypatch.setattr(move_handle, "MoveHandle", Handle)
    monkeypatch.setattr(
        robot,
        "_connection",
        SimpleNamespace(
            call=lambda *_: None, explain=None, close=lambda: None, naming_versions=nullcontext
        ),
    )
    robot._stub = SimpleNamespace(Move=None)
    move("first")
    move("second")
    other[0].join()
    robot.close()
    assert sorted(abandoned) == ["first", "other", "second"]
