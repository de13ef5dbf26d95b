"""`orientd serve rotctld` over its socket, with Hamlib's own clients where they are installed."""

import contextlib
import math
import random
import shutil
import subprocess
import time

import numpy as np
import pytest
from harness import DEVICE, DaemonProcess, until
from reference.pass_due import pass_due
from rotator import Client, rotctld

from orientd.client.robot import connect
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

needs_hamlib = pytest.mark.skipif(
    shutil.which("rotctl") is None, reason="rotctl of Hamlib is not installed"
)


@pytest.fixture(scope="module")
def server(daemon):
    with rotctld(daemon) as client:
        yield client


@pytest.fixture
def client(server):
    opened = Client(server.port)
    yield opened
    opened.close()


def ahead(q):
    """Where the x axis of a tool points in the world."""
    w, x, y, z = q.w, q.x, q.y, q.z
    return (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))


def asked(words):
    """Where that is in the world, whose x axis points north."""
    azimuth, elevation = (math.radians(float(word)) for word in words)
    level = math.cos(elevation)
    return level * math.cos(azimuth), -level * math.sin(azimuth), math.sin(elevation)


def test_north_and_ranges_are_as_given(daemon):
    with rotctld(daemon, "--north", 90, "--azimuth", "0:450", "--elevation", "0:180") as client:
        assert client.ask("P 400 20") == ["RPRT 0"]
        client.await_position(400.0, 20.0)
        assert client.ask("P 451 20") == ["RPRT -1"]
        assert client.ask("P 10 -1") == ["RPRT -1"]
        assert client.ask("P 220 160") == ["RPRT 0"]
        client.await_position(220.0, 160.0)
        # 40 degrees clockwise from north, which is the world's y axis.
        assert ahead(daemon.device().cycle.q) == pytest.approx((0.6040, 0.7198, 0.3420), abs=1e-3)


def test_what_hamlibs_client_sends_points_the_device(daemon):
    """Lines and formats are those of Hamlib's ``netrotctl.c``."""
    with rotctld(daemon, "--azimuth", "-10:450", "--elevation", "0:90") as client:
        version, model, *settings, end = client.ask("\\dump_state", 9)
        assert (int(version), int(model) > 0, end) == (1, True, "done")
        ranges = dict(line.split("=") for line in settings)
        assert [float(ranges[name]) for name in ("min_az", "max_az", "min_el", "max_el")] == [
            -10.0, 450.0, 0.0, 90.0
        ]  # fmt: skip
        assert client.ask("_")[0].endswith(f": {DEVICE}")
        for azimuth, elevation in ((370.0, 20.0), (95.25, 61.5)):
            assert client.ask(f"P {azimuth:f} {elevation:f}") == ["RPRT 0"]
            client.await_position(azimuth, elevation)
        assert client.ask("S") == ["RPRT 0"]
    until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
    assert ahead(daemon.device().cycle.q) == pytest.approx(asked(("95.25", "61.5")), abs=1e-3)


def test_a_device_tips_over_at_the_zenith(daemon):
    """A target crosses the zenith at 5 degrees a second; the azimuth of the tool stays."""
    with rotctld(daemon, "--elevation", "0:180") as client:
        assert client.ask("P 20 75") == ["RPRT 0"]
        client.await_position(20.0, 75.0)
        begin = time.monotonic()
        for k in range(9):
            time.sleep(max(0.0, begin + 0.7 * k - time.monotonic()))
            last = 75.0 + 5.0 * (time.monotonic() - begin)
            assert client.ask(f"P 20 {last:.2f}") == ["RPRT 0"]
        assert abs(client.position()[0] - 20.0) < 0.1
        client.await_position(20.0, round(last, 2))


# As rotctld 4.5.4 of Hamlib answers them for its dummy rotator.
@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("+S", ["stop:", "RPRT 0"]),
        (";S", ["stop:;RPRT 0"]),
        ("+\\set_pos 1 2", ["set_pos: 1 2", "RPRT 0"]),
        ("+P x y", ["set_pos: x y", "RPRT -1"]),
        ("P 10,5 6,5", ["RPRT 0"]),
        ("P 999 20", ["RPRT -1"]),
        ("P 10 99", ["RPRT -1"]),
        ("P x y", ["RPRT -1"]),
        ("R x", ["RPRT -1"]),
        ("R 1", ["RPRT 0"]),
        ("M 99 5", ["RPRT -1"]),
        ("# a comment\nS", ["RPRT 0"]),
        ("\n\r\nSS", ["RPRT 0", "RPRT 0"]),
        ("P 1 2 S", ["RPRT 0", "RPRT 0"]),
        ("S;S", ["RPRT 0", "stop:;RPRT 0"]),
        ("\\stop", ["RPRT 0"]),
    ],
)
def test_an_answer_is_that_of_rotctld(client, line, answer):
    assert client.ask(line, len(answer)) == answer


def test_positions_are_answered_in_both_forms(client):
    client.ask("P 30 40")
    client.await_position(30.0, 40.0)
    assert [round(float(word)) for word in client.ask("p", 2)] == [30, 40]
    first, *values, code = client.ask("+\\get_pos", 4)
    assert (first, code) == ("get_pos:", "RPRT 0")
    assert [value.partition(":")[0] for value in values] == ["Azimuth", "Elevation"]
    assert client.ask("|p")[0].split("|")[0] == "get_pos:"


def test_commands_of_other_rotators_are_said_to_be_unavailable(client):
    assert client.ask("V SPEED 5") == ["RPRT -11"]
    assert client.ask("\\get_level SPEED") == ["RPRT -11"]


@needs_hamlib
def test_hundred_commands_of_the_real_client(client, daemon):
    """A session of rotctl: every command that it has, and directions in any turn."""
    chosen = random.Random(4533)
    directions = [
        (f"{chosen.uniform(-180, 540):.2f}", f"{chosen.uniform(0, 90):.2f}") for _ in range(20)
    ]
    lines, last = ["_", "1", "K", "R 1", "M 16 50", "S"], ("0", "0")
    for last in directions:
        lines += [f"P {last[0]} {last[1]}", "p", "S", f"P {last[0]} {last[1]}"]
    lines += ["p"] * 14
    assert len(lines) == 100
    done = subprocess.run(
        ["rotctl", "-m", "2", "-r", f"127.0.0.1:{client.port}", "-"],
        input="\n".join(lines),
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert "error" not in done.stdout + done.stderr, done
    assert done.returncode == 0
    assert f": {DEVICE}" in done.stdout
    until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
    assert ahead(daemon.device().cycle.q) == pytest.approx(asked(last), abs=1e-4)


def test_malformed_lines_change_nothing_and_are_answered(client, daemon):
    """10,000 lines that are no command: each is answered with a code below zero."""
    client.ask("S")
    until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
    before = daemon.device()
    chosen = random.Random(7)
    words = ["nan", "-inf", "1e999", "x", "1_0", "0x10", "--5", "1.2.3", "1,2,3", "\x07", "é"]
    heads = ["P", "\\set_pos", "M", "\\move", "+P", ";P", "|\\set_pos"]
    others = ["?", "Z", "y", "\\", "\\nonsense", "\\P", "\x00x", "\xff", "3"]

    def line():
        kind, head = chosen.randrange(4), chosen.choice(heads)
        if kind == 0:
            return chosen.choice(others) + "".join(chosen.choices(" PpSK10", k=chosen.randrange(6)))
        if kind == 1:
            return f"{head} {chosen.choice(words)} {chosen.choice(words)}"
        if kind == 2:
            return chosen.choice([head, f"{head} {chosen.random()}", f"R {chosen.choice(words)}"])
        return f"{head} {chosen.choice(words)} {chosen.uniform(0, 90)}"

    lines = [line().encode("latin-1") for _ in range(10_000)]
    for at in range(0, len(lines), 200):
        client.socket.sendall(b"".join(one + b"\n" for one in lines[at : at + 200]))
        for one in lines[at : at + 200]:
            code = client.lines.readline()
            if code.startswith(("set_pos:", "move:", "reset:")) and "RPRT" not in code:
                code = client.lines.readline()
            assert code.rstrip("\n").rpartition("RPRT ")[2] in {"-1", "-11"}, (one, code)
    after = daemon.device()
    assert after.motion_number == before.motion_number
    assert after.cycle.q == before.cycle.q
    assert client.ask("S") == ["RPRT 0"]


def is_served(port):
    """Connect and ask; return whether the server answers rather than hangs up."""
    with contextlib.closing(Client(port)) as one:
        try:
            return one.ask("p") != [""]
        except ConnectionError:
            return False


def test_a_server_has_so_many_clients_and_no_more(daemon):
    with rotctld(daemon) as client, contextlib.ExitStack() as stack:
        others = [Client(client.port) for _ in range(31)]
        for one in others:
            stack.callback(one.close)
            one.position()
        assert not is_served(client.port)
        client.position()
        others[3].close()
        until(lambda: is_served(client.port), "another client to be served")


def test_a_direction_is_reached_again_after_a_stop_of_somebody_else(client, daemon):
    client.ask("P 170 10")
    with connect(daemon.socket) as robot:
        robot.stop(DEVICE)
    assert client.ask("P 100 10") == ["RPRT 0"]
    client.await_position(100.0, 10.0)


def test_a_move_goes_on_until_a_stop(client):
    client.ask("P 0 0")
    client.await_position(0.0, 0.0)
    assert client.ask("M RIGHT 20") == ["RPRT 0"]
    until(lambda: client.position()[0] > 5.0, "a turn to the right")
    assert client.ask("S") == ["RPRT 0"]
    assert client.position()[0] < 115.0


def test_positions_once_a_second_are_followed_without_a_stop_between(client, daemon):
    """A target crosses north at 4 degrees a second, and the setpoints stay with it."""
    begin = time.monotonic() + 0.5

    def target(at):
        return -8.0 + 4.0 * (at - begin), 30.0

    seen = []
    with connect(daemon.socket) as robot:
        cycles = robot.watch(DEVICE, rate_hz=20)
        client.ask(f"P {target(begin)[0]:.3f} 30")
        for k in range(9):
            time.sleep(max(0.0, begin + 0.7 * k - time.monotonic()))
            azimuth, elevation = target(time.monotonic())
            assert client.ask(f"P {azimuth:.3f} {elevation:.3f}") == ["RPRT 0"]
        while not seen or seen[-1].deadline_ns * 1e-9 < begin + 6.0:
            seen += next(cycles)
    late = [one for one in seen if one.deadline_ns * 1e-9 > begin + 3.0]
    apart = [
        math.degrees(math.dist(_ahead(one.q), asked(target(one.deadline_ns * 1e-9))))
        for one in late
    ]
    assert max(apart) < 0.5
    assert min(math.hypot(*one.omega_body) for one in late) > math.radians(2.0)


@pytest.mark.parametrize(("elevation", "heading"), [(86.0, "north"), (50.0, "east")])
def test_positions_as_gpredict_sends_them_keep_a_device_on_a_satellite(
    client, daemon, elevation, heading
):
    """Every 200 ms gpredict asks for the position, and sends another if 0.1 degrees are missing."""
    begin = time.time()
    due = pass_due(begin + 25.0, elevation=elevation, heading=heading)
    cycles = []
    with connect(daemon.socket) as robot:
        watched = robot.watch(DEVICE, rate_hz=5, decimation=25)
        for k in range(200):
            time.sleep(max(0.0, begin + 0.2 * k - time.time()))
            there = client.position()
            to = np.concatenate(due.directions([time.time()]))
            if np.max(np.abs(to - there)) > 0.1:
                assert client.ask("P {:.2f} {:.2f}".format(*to)) == ["RPRT 0"]
            cycles += next(watched)
    late = [one for one in cycles if one.deadline_ns * 1e-9 > cycles[0].deadline_ns * 1e-9 + 5.0]
    clock = time.time() - time.monotonic()
    directions = np.transpose(due.directions([one.deadline_ns * 1e-9 + clock for one in late]))
    pointed = np.array([_ahead(one.q) for one in late])
    apart = np.degrees(np.linalg.norm(pointed - [asked(to) for to in directions], axis=-1))
    assert np.median(apart) < 0.05
    assert np.quantile(apart, 0.95) < 0.15


def _ahead(q):
    return ahead(pb.Quaternion(**dict(zip("wxyz", np.array(q).tolist(), strict=True))))


def test_a_daemon_that_is_lost_is_an_answer(tmp_path):
    with DaemonProcess(tmp_path / "lost") as lost:
        lost.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=lost.token))
        with rotctld(lost) as client:
            assert client.ask("P 10 10") == ["RPRT 0"]
            lost.process.kill()
            until(lambda: client.ask("P 40 10") == ["RPRT -6"], "the loss")
            assert client.ask("p") == ["RPRT -6"]
