"""The clients judge the motion that they have stopped, and find one that goes on."""

from types import SimpleNamespace

import pytest
from clients import Client

from orientd.stream.records import ServoState

HOLDING, STREAMING = ServoState.HOLDING, ServoState.STREAMING


class Stopper(Client):
    """A client that sees one state of the device after another; no daemon answers it."""

    def __init__(self, *seen):
        self.problems, self.requests, self.seen = [], [], list(seen)
        scheduler = SimpleNamespace(sleep=lambda _seconds: None)
        self.system = SimpleNamespace(
            scheduler=scheduler, is_calm=True, tell=self.problems.append, random=None
        )

    def ask(self, _method, request):
        self.requests.append(request)

    def _present(self):
        return self.seen.pop(0)


def test_a_motion_that_begins_after_the_look_is_neither_stopped_nor_judged():
    client = Stopper((HOLDING, 8), (STREAMING, 9), (STREAMING, 9))
    client.stop_one()
    assert [request.motion_number for request in client.requests] == [8]
    assert client.problems == []


@pytest.mark.parametrize("kind", ["stop", "stop_one", "halt"])
def test_a_stopped_motion_that_goes_on_is_found(kind):
    client = Stopper((STREAMING, 9), (STREAMING, 9))
    getattr(client, kind)()
    (problem,) = client.problems
    assert "motion 9 still moves after 4 s" in problem
