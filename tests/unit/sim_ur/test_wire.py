"""RTDE bytes, and one client's conversation without a socket."""

import struct

import pytest

from emulated_ur.controller import Controller, Event
from emulated_ur.rtde import (
    Layout,
    Package,
    PackageKind,
    PackageSplitter,
    RtdeSession,
    WireError,
)


class Client:
    """A hand-written client on a session without a socket."""

    def __init__(self, robot=None, owners=None):
        self.robot = robot or Controller()
        self.owners = {} if owners is None else owners
        self.session = RtdeSession(self.robot, self.owners, self.robot.write_package)

    def ask(self, kind, payload=b""):
        (reply,) = PackageSplitter().feed(self.session.feed(Package(kind, payload).packed()))
        assert reply.kind == kind
        return reply.payload

    def speak_version_2(self):
        assert self.ask(PackageKind.VERSION, b"\0\2") == b"\1"
        return self

    def outputs(self, names, frequency=500.0):
        return self.ask(PackageKind.OUTPUTS, struct.pack(">d", frequency) + names)


def test_packages_come_out_whole_however_they_were_cut():
    stream = b"".join(Package(PackageKind.MESSAGE, bytes(n)).packed() for n in range(40))
    for width in (1, 2, 3, 7, 1000):
        splitter = PackageSplitter()
        found = [
            package
            for at in range(0, len(stream), width)
            for package in splitter.feed(stream[at : at + width])
        ]
        assert found == [Package(PackageKind.MESSAGE, bytes(n)) for n in range(40)]


def test_impossible_size_is_refused():
    with pytest.raises(WireError, match="size"):
        PackageSplitter().feed(b"\0\2V")


def test_layout_reads_back_what_it_packs():
    layout = Layout(["a", "b", "c"], ["VECTOR6D", "UINT64", "BOOL"])
    values = [(0.1, 0.2, 0.3, 0.4, 0.5, 0.6), 2**63, 1]
    assert layout.unpack(layout.pack(values) + b"more") == values
    with pytest.raises(WireError, match="57 bytes, got 3"):
        layout.unpack(b"abc")


def test_both_versions_are_accepted_and_no_other():
    client = Client()
    assert [client.ask(PackageKind.VERSION, struct.pack(">H", n)) for n in (1, 2, 3)] == [
        b"\1", b"\1", b"\0",
    ]  # fmt: skip


def test_controller_version_is_four_numbers():
    assert struct.unpack(">4I", Client().ask(PackageKind.CONTROLLER_VERSION)) == (5, 12, 6, 1102099)


@pytest.mark.parametrize("names", [b"timestamp,actual_q", b"timestamp,actual_q,"])
def test_outputs_are_answered_by_recipe_and_types(names):
    assert Client().speak_version_2().outputs(names) == b"\1DOUBLE,VECTOR6D"


def test_unknown_output_is_not_found_and_start_refused():
    client = Client().speak_version_2()
    assert client.outputs(b"timestamp,nonsense") == b"\0DOUBLE,NOT_FOUND"
    assert client.ask(PackageKind.START) == b"\0"


def test_data_comes_at_the_frequency_asked_for():
    client = Client().speak_version_2()
    client.outputs(b"timestamp", 125.0)
    assert client.ask(PackageKind.START) == b"\1"
    sent = []
    for _ in range(40):
        client.robot.tick()
        sent.append(client.session.tick())
    (package,) = PackageSplitter().feed(next(filter(None, sent)))
    assert len(list(filter(None, sent))) == 10
    assert (package.kind, package.payload[0], len(package.payload)) == (PackageKind.DATA, 1, 9)
    assert client.ask(PackageKind.PAUSE) == b"\1"
    assert client.session.tick() == b""


def test_version_1_has_neither_frequency_nor_recipe_number():
    client = Client()
    assert client.ask(PackageKind.OUTPUTS, b"timestamp") == b"DOUBLE"
    assert client.ask(PackageKind.START) == b"\1"
    for _ in range(4):
        client.robot.tick()
    (package,) = PackageSplitter().feed(client.session.tick())
    assert struct.unpack(">d", package.payload) == (client.robot.timestamp,)


def test_inputs_are_numbered_and_belong_to_one_client():
    robot, owners = Controller(), {}
    first, second = (Client(robot, owners).speak_version_2() for _ in range(2))
    assert first.ask(PackageKind.INPUTS, b"input_int_register_0") == b"\1INT32"
    assert first.ask(PackageKind.INPUTS, b"input_int_register_0,input_double_register_0") == (
        b"\2INT32,DOUBLE"
    )
    assert second.ask(PackageKind.INPUTS, b"input_int_register_0,speed_slider_mask") == (
        b"\0IN_USE,UINT32"
    )
    first.session.close()
    assert second.ask(PackageKind.INPUTS, b"input_int_register_0") == b"\1INT32"


def test_short_input_package_is_dropped_and_a_long_one_taken():
    client = Client().speak_version_2()
    client.ask(PackageKind.INPUTS, b"input_int_register_3,input_double_register_3")
    client.session.feed(
        Package(PackageKind.DATA, b"\1" + struct.pack(">id", 7, 0.5) + b"more").packed()
    )
    client.session.feed(Package(PackageKind.DATA, b"\1" + struct.pack(">i", 9)).packed())
    assert (
        client.robot.value("input_int_register_3"),
        client.robot.value("input_double_register_3"),
    ) == (7, 0.5)
    assert client.session.malformed == 1


def test_messages_wait_until_the_client_listens():
    client = Client().speak_version_2()
    assert client.session.tell(Event("log", "hello")) == b""
    client.outputs(b"timestamp")
    client.ask(PackageKind.START)
    (package,) = PackageSplitter().feed(client.session.tell(Event("log", "hello")))
    assert package.payload == b"\5hello\x0bemulated_ur\3"
