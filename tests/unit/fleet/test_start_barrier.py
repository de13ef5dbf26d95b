import time

from orientd.fleet.start_barrier import DROPPED, READY, StartBarrier

FAR_NS = 3_600_000_000_000


class Network:
    """Barriers that hear each other at once, as far as they are connected."""

    def __init__(self, *names):
        self.done = {name: [] for name in names}
        self.barriers = {
            name: StartBarrier(name, lambda start, what, name=name: self.say(name, start, what))
            for name in names
        }

    def say(self, name, start, what):
        for barrier in self.barriers.values():
            barrier.hear(start, name, what)

    def join(self, name, *, parts=1, start_ns=None, until_ns=None):
        done = self.done[name]
        now = time.monotonic_ns()
        self.barriers[name].join(
            "s",
            frozenset(self.barriers),
            parts=parts,
            start_ns=now + FAR_NS if start_ns is None else start_ns,
            until_ns=now + FAR_NS if until_ns is None else until_ns,
            begin=lambda: done.append("begun"),
            refuse=lambda why: done.append(f"refused: {why}"),
            drop=lambda: done.append("dropped"),
        )


def test_nobody_begins_before_the_last_was_asked():
    network = Network("a", "b", "c")
    network.join("a")
    network.join("b")
    assert network.done == {"a": [], "b": [], "c": []}
    network.join("c")
    assert network.done == {"a": ["begun"], "b": ["begun"], "c": ["begun"]}


def test_a_daemon_with_two_motions_is_ready_with_both():
    network = Network("a", "b")
    network.join("b")
    network.join("a", parts=2)
    assert network.done["b"] == []
    network.join("a", parts=2)
    assert network.done == {"a": ["begun", "begun"], "b": ["begun"]}


def test_others_may_be_heard_before_the_request():
    network = Network("a", "b")
    network.barriers["a"].hear("s", "b", READY)
    network.join("a")
    assert network.done["a"] == ["begun"]


def test_a_refusal_drops_what_has_been_handed_on():
    network = Network("a", "b")
    network.join("a")
    network.join("b")
    network.barriers["b"].fail("s", "cannot")
    assert network.done == {"a": ["begun", "dropped"], "b": ["begun", "dropped"]}


def test_a_daemon_that_leaves_before_the_start_has_it_dropped():
    network = Network("a", "b")
    network.join("a")
    network.join("b")
    network.barriers["a"].lose("b")
    assert network.done["a"] == ["begun", "dropped"]


def test_what_has_started_is_not_dropped_by_the_barrier():
    network = Network("a", "b")
    network.join("a", start_ns=0)
    network.join("b", start_ns=0)
    network.barriers["a"].lose("b")
    network.barriers["b"].fail("s", "too late")
    assert network.done == {"a": ["begun"], "b": ["begun"]}


def test_a_start_that_was_dropped_takes_nobody_any_more():
    network = Network("a", "b")
    network.barriers["a"].hear("s", "b", DROPPED)
    network.join("a")
    assert network.done["a"] == ["refused: b cannot begin"]


def test_what_is_not_complete_in_time_is_refused_by_all():
    network = Network("a", "b", "c")
    network.join("a")
    network.join("b", until_ns=0)
    while not network.done["b"]:
        time.sleep(0.001)
    assert network.done["b"] == ["refused: c was not ready in time, so nothing begins"]
    assert network.done["a"] == ["refused: b cannot begin"]
    network.join("c")
    assert network.done["c"][0].startswith("refused")
