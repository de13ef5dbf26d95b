"""A client that only watches keeps nothing of what has ended."""

import gc
import weakref
from types import SimpleNamespace

import pytest

from orientd.client.observer import Observer
from orientd.protocol import control_pb2 as pb


class Stream:
    """A call that answers twice, and notes that it was cancelled."""

    is_cancelled = False

    def __iter__(self):
        return iter([pb.WatchEventsResponse(events=[pb.Event(text="a")])] * 2)

    def cancel(self):
        self.is_cancelled = True


@pytest.fixture
def made():
    return []


@pytest.fixture
def observer(made):
    def call(method, request):
        made.append(Stream())
        return made[-1]

    stub = SimpleNamespace(WatchEvents=None)
    return Observer(SimpleNamespace(stub=stub, call=call, way="here"))


@pytest.mark.parametrize("taken", [1, 2, 3])
def test_a_subscription_that_has_ended_is_not_kept(observer, made, taken):
    events = observer.events()
    for _ in range(taken):
        next(events, None)
    events.close()
    kept = weakref.ref(made.pop())
    del events
    gc.collect()
    assert kept() is None


def test_the_end_of_the_observer_ends_its_subscriptions(observer, made):
    events = observer.events()
    assert next(events).text == "a"
    observer.close()
    assert made[0].is_cancelled
