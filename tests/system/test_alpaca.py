"""`orientd serve alpaca` with the real client of ASCOM, alpyca, and with requests of no client."""

import contextlib
import http.client
import json
import math
import random
import signal
import socket
import time
from urllib.parse import urlencode

import pytest
from command_line import assert_refused, begin, orientd
from gimbal_bench import GimbalDaemon, await_hold
from harness import DEVICE, DaemonProcess, until

from orientd import connect
from orientd.protocol import control_pb2 as pb

pytest.importorskip("alpaca.telescope")

from alpaca import discovery, exceptions, management
from alpaca.rotator import Rotator
from alpaca.telescope import Telescope, TelescopeAxes

pytestmark = pytest.mark.world

PRIMARY, SECONDARY = TelescopeAxes.axisPrimary, TelescopeAxes.axisSecondary
TERTIARY = TelescopeAxes.axisTertiary
PARK = b"PUT /api/v1/telescope/0/park HTTP/1.1\r\nContent-Length: "
CLOSE = 0.02
"""Degrees."""


class Served:
    """A running server with a telescope and a rotator of alpyca."""

    def __init__(self, process, line):
        self.process = process
        self.address = line.split()[2]
        self.telescope, self.rotator = Telescope(self.address, 0), Rotator(self.address, 0)

    def connect(self):
        self.telescope.Connected = True
        self.rotator.Connected = True
        return self

    def slew(self, azimuth, altitude):
        self.telescope.SlewToAltAzAsync(azimuth, altitude)
        self.await_rest()

    def await_rest(self):
        until(lambda: not (self.telescope.Slewing or self.rotator.IsMoving), "the end of the slew")

    def direction(self):
        return self.telescope.Azimuth, self.telescope.Altitude

    def end(self, number=signal.SIGINT):
        self.process.send_signal(number)
        rest, errors = self.process.communicate(timeout=30.0)
        assert (self.process.returncode, errors) == (0, "")
        return rest


@contextlib.contextmanager
def alpaca(daemon, *arguments):
    process = begin("serve", "alpaca", "--port", 0, "--discovery", 0, "--socket", daemon.socket,
                    *arguments)  # fmt: skip
    line = process.stdout.readline()
    assert line.startswith("ready at 127.0.0.1:"), (line, process.stderr.read())
    served = Served(process, line)
    yield served
    assert served.end() == f"{line.split()[-1].rstrip(')')} is at rest\n"


@pytest.fixture
def served(daemon):
    with alpaca(daemon, "--observer", "50.1,8.6", "--park", "90,10") as it:
        it.connect().slew(0.0, 0.0)
        it.rotator.MoveMechanical(0.0)
        it.await_rest()
        yield it


def is_near(angle, expected, tolerance=CLOSE):
    return abs(math.remainder(angle - expected, 360.0)) < tolerance


# ---------------------------------------------------------------- the session of a real client


def test_a_session_of_a_hundred_commands(served, daemon):
    telescope, rotator = served.telescope, served.rotator
    generator = random.Random(7)
    commands = 0
    for k in range(30):
        azimuth, altitude = generator.uniform(0.0, 359.9), generator.uniform(-30.0, 85.0)
        telescope.SlewToAltAzAsync(azimuth, altitude)
        position = generator.uniform(0.0, 360.0)
        rotator.MoveAbsolute(position)
        commands += 2
        if k % 3 == 0:
            # A new target replaces the old one on its way.
            azimuth = generator.uniform(0.0, 359.9)
            telescope.SlewToAltAzAsync(azimuth, altitude)
            commands += 1
        served.await_rest()
        assert is_near(telescope.Azimuth, azimuth)
        assert telescope.Altitude == pytest.approx(altitude, abs=CLOSE)
        assert is_near(rotator.Position, position)
        if k % 4 == 0:
            telescope.MoveAxis(PRIMARY, 20.0)
            telescope.MoveAxis(SECONDARY, -5.0)
            telescope.MoveAxis(PRIMARY, 0.0)
            telescope.MoveAxis(SECONDARY, 0.0)
            commands += 4
        if k % 5 == 0:
            rotator.Sync(10.0)
            rotator.Reverse = not rotator.Reverse
            commands += 2
    telescope.AbortSlew()
    rotator.Halt()
    assert commands + 2 >= 100
    daemon.assert_limits_kept()


def test_the_azimuth_counts_clockwise_from_north(daemon):
    with alpaca(daemon, "--north", "90") as served:
        served.connect().slew(30.0, 20.0)
        q = daemon.device().cycle.q
        ahead = (
            1 - 2 * (q.y**2 + q.z**2),
            2 * (q.x * q.y + q.w * q.z),
            2 * (q.x * q.z - q.w * q.y),
        )
        # North is the world's y axis, so 30 degrees clockwise from it are 60 from x.
        expected = [math.cos(math.radians(20)) * f(math.radians(60)) for f in (math.cos, math.sin)]
        assert ahead == pytest.approx((*expected, math.sin(math.radians(20))), abs=1e-4)


def test_an_axis_moves_at_its_rate_and_stops(served):
    telescope = served.telescope
    (rates,) = telescope.AxisRates(PRIMARY)
    assert rates.Minimum == 0.0
    assert rates.Maximum == pytest.approx(0.9 * math.degrees(2.5), abs=0.01)
    telescope.MoveAxis(PRIMARY, 20.0)
    assert telescope.Slewing
    until(lambda: 5.0 < telescope.Azimuth < 180.0, "the axis to move")
    times, angles = [], []
    for _ in range(40):
        times.append(time.monotonic())
        angles.append(telescope.Azimuth)
    rate = (angles[-1] - angles[0]) / (times[-1] - times[0])
    assert rate == pytest.approx(20.0, rel=0.5)
    telescope.MoveAxis(PRIMARY, 0.0)
    assert not telescope.Slewing
    rest = served.direction()
    assert rest[1] == pytest.approx(0.0, abs=CLOSE)
    until(lambda: daemon_rests(served), "rest")
    assert served.direction() == pytest.approx(rest, abs=CLOSE)


def daemon_rests(served):
    before = served.direction()
    return served.direction() == pytest.approx(before, abs=1e-6)


def test_tracking_follows_the_sky(served):
    telescope = served.telescope
    assert telescope.SiteLatitude == pytest.approx(50.1)
    served.slew(120.0, 40.0)
    telescope.Tracking = True
    right_ascension, declination = telescope.RightAscension, telescope.Declination
    azimuth = telescope.Azimuth
    until(lambda: telescope.Azimuth - azimuth > 0.01, "the sky to turn")
    assert telescope.RightAscension == pytest.approx(right_ascension, abs=1e-3)
    assert telescope.Declination == pytest.approx(declination, abs=1e-2)
    hours = (right_ascension + 1.0) % 24.0
    telescope.SlewToCoordinatesAsync(hours, declination - 5.0)
    served.await_rest()
    assert is_near(15.0 * telescope.RightAscension, 15.0 * hours, 0.1)
    assert telescope.Declination == pytest.approx(declination - 5.0, abs=0.1)
    assert telescope.TargetRightAscension == pytest.approx(hours)
    telescope.Tracking = False
    assert not telescope.Tracking


def test_the_rotator_turns_while_the_telescope_tracks(served):
    telescope, rotator = served.telescope, served.rotator
    served.slew(120.0, 40.0)
    telescope.Tracking = True
    rotator.MoveAbsolute(40.0)
    until(lambda: is_near(rotator.Position, 40.0, 0.1), "the rotator to turn")
    assert telescope.Tracking
    telescope.Tracking = False


def test_a_slew_keeps_the_camera_level_or_at_its_position(served):
    served.rotator.MoveAbsolute(25.0)
    served.await_rest()
    served.slew(200.0, 60.0)
    assert is_near(served.rotator.Position, 25.0)


def test_sync_and_reverse_move_nothing(served, daemon):
    rotator = served.rotator
    rotator.MoveAbsolute(20.0)
    served.await_rest()
    before = daemon.device().motion_number
    rotator.Sync(90.0)
    assert is_near(rotator.Position, 90.0)
    assert is_near(rotator.MechanicalPosition, 20.0)
    rotator.Reverse = True
    assert is_near(rotator.Position, 90.0)
    assert daemon.device().motion_number == before
    rotator.Move(10.0)
    served.await_rest()
    assert is_near(rotator.Position, 100.0)
    assert is_near(rotator.MechanicalPosition, 10.0)
    assert is_near(rotator.TargetPosition, 100.0)


def test_a_rotator_without_symmetry_turns_the_short_way(served):
    served.rotator.MoveAbsolute(190.0)
    served.await_rest()
    assert is_near(served.rotator.MechanicalPosition, 190.0)
    assert is_near(served.rotator.Position, 190.0)


def test_a_symmetric_rotator_takes_the_nearer_of_two_rolls(daemon):
    with alpaca(daemon, "--symmetric") as served:
        served.connect().slew(0.0, 0.0)
        served.rotator.MoveMechanical(0.0)
        served.await_rest()
        served.rotator.MoveAbsolute(190.0)
        served.await_rest()
        assert is_near(served.rotator.MechanicalPosition, 10.0)
        assert is_near(served.rotator.Position, 190.0)
        served.rotator.Move(80.0)
        served.await_rest()
        assert is_near(served.rotator.Position, 270.0)
        assert is_near(served.rotator.MechanicalPosition, 90.0)


def test_a_parked_telescope_refuses_to_move_until_unparked(served):
    telescope = served.telescope
    telescope.Park()
    until(lambda: telescope.AtPark, "the telescope to park")
    assert served.direction() == pytest.approx((90.0, 10.0), abs=CLOSE)
    for command in (
        lambda: telescope.SlewToAltAzAsync(10.0, 10.0),
        lambda: telescope.MoveAxis(PRIMARY, 1.0),
        telescope.AbortSlew,
        lambda: setattr(telescope, "Tracking", True),
    ):
        with pytest.raises(exceptions.ParkedException):
            command()
    telescope.Unpark()
    assert not telescope.AtPark
    served.slew(20.0, 5.0)
    telescope.SetPark()
    served.slew(0.0, 0.0)
    telescope.Park()
    until(lambda: telescope.AtPark, "the telescope to park")
    assert served.direction() == pytest.approx((20.0, 5.0), abs=CLOSE)
    telescope.Unpark()


def test_abort_stops_a_slew_on_its_path(served, daemon):
    served.telescope.SlewToAltAzAsync(170.0, 0.0)
    served.telescope.AbortSlew()
    assert not served.telescope.Slewing
    until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
    assert served.telescope.Azimuth < 160.0
    daemon.assert_limits_kept()


def test_a_telescope_that_tracks_goes_on_after_an_abort(served, daemon):
    telescope = served.telescope
    served.slew(120.0, 40.0)
    telescope.Tracking = True
    telescope.AbortSlew()
    assert telescope.Tracking
    until(lambda: daemon.device().state == pb.STATE_TRACKING, "the telescope to track")
    telescope.Tracking = False


def test_each_refusal_has_its_error_number(served, daemon):
    telescope, rotator = served.telescope, served.rotator
    before = daemon.device().motion_number
    for refused, command in (
        (exceptions.InvalidValueException, lambda: telescope.SlewToAltAzAsync(361.0, 0.0)),
        (exceptions.InvalidValueException, lambda: telescope.SlewToAltAzAsync(0.0, 91.0)),
        (exceptions.InvalidValueException, lambda: telescope.MoveAxis(PRIMARY, 1000.0)),
        (exceptions.InvalidValueException, lambda: telescope.MoveAxis(TERTIARY, 1.0)),
        (exceptions.InvalidValueException, lambda: setattr(telescope, "SiteLatitude", 91.0)),
        (exceptions.InvalidValueException, lambda: rotator.MoveAbsolute(360.1)),
        (exceptions.InvalidValueException, lambda: rotator.MoveMechanical(-0.1)),
        (exceptions.InvalidValueException, lambda: rotator.Sync(405.0)),
        (exceptions.InvalidOperationException, lambda: telescope.SlewToCoordinatesAsync(1.0, 1.0)),
        (exceptions.ValueNotSetException, lambda: telescope.TargetDeclination),
        (exceptions.NotImplementedException, telescope.FindHome),
        (exceptions.NotImplementedException, lambda: telescope.SyncToAltAz(1.0, 1.0)),
        (exceptions.NotImplementedException, lambda: telescope.SideOfPier),
        (exceptions.NotImplementedException, lambda: rotator.StepSize),
        (exceptions.NotImplementedException, lambda: rotator.CommandBlind("x", Raw=True)),
        (exceptions.ActionNotImplementedException, lambda: rotator.Action("polish", "all")),
    ):  # fmt: skip
        with pytest.raises(refused):
            command()
    telescope.Connected = False
    with pytest.raises(exceptions.NotConnectedException):
        telescope.SlewToAltAzAsync(10.0, 10.0)
    assert daemon.device().motion_number == before


def test_a_lease_that_another_client_holds_is_an_invalid_operation(daemon):
    with alpaca(daemon) as served, connect(daemon.socket) as robot:
        served.connect()
        robot.acquire_lease(DEVICE)
        with pytest.raises(exceptions.InvalidOperationException, match="lease"):
            served.telescope.SlewToAltAzAsync(10.0, 10.0)


def test_two_clients_are_connected_for_themselves(served):
    other = Telescope(served.address, 0)
    answers = []
    for client in (1, 2):
        query = urlencode({"ClientID": client, "ClientTransactionID": 5})
        answers.append(ask(served, "GET", f"/api/v1/telescope/0/connected?{query}"))
    assert [value["Value"] for _, value in answers] == [False, False]
    ask(served, "PUT", "/api/v1/telescope/0/connected", "Connected=True&ClientID=2")
    query = urlencode({"ClientID": 2})
    assert ask(served, "GET", f"/api/v1/telescope/0/connected?{query}")[1]["Value"]
    assert other.Connected  # alpyca has one client number


# ---------------------------------------------------------------- a gimbal with limits


@pytest.mark.real
def test_an_azimuth_beyond_the_limit_is_reached_the_other_way_round(bus, tmp_path):
    pytest.importorskip("dynamixel_sdk")
    daemon = GimbalDaemon(tmp_path, bus.link).start()
    try:
        await_hold(daemon, "gimbal")
        with alpaca(daemon) as served:
            served.connect()
            # The azimuth counts clockwise, so yaw goes to -100, then to -200 degrees.
            for azimuth in (100.0, 200.0):
                served.slew(azimuth, 0.0)
            assert yaw(bus) == pytest.approx(-200.0, abs=1.0)
            # Yaw ends at -270: -273 is out of reach, and 87 is the same azimuth.
            served.slew(273.0, 0.0)
            assert served.telescope.Azimuth == pytest.approx(273.0, abs=1.0)
            assert yaw(bus) == pytest.approx(87.0, abs=1.0)
    finally:
        daemon.end()


def yaw(bus):
    return (bus.state(1)["goal"] - 2048) * 360.0 / 4096.0


# ---------------------------------------------------------------- the protocol


def ask(served, verb, path, body=None, headers=None):
    """Return status and answer of a request; the answer of a good one as a mapping."""
    connection = http.client.HTTPConnection(served.address, timeout=30.0)
    try:
        kind = {"Content-Type": "application/x-www-form-urlencoded"}
        connection.request(verb, path, body, kind | (headers or {}))
        answered = connection.getresponse()
        text = answered.read()
        return answered.status, json.loads(text) if answered.status == 200 else text.decode()
    finally:
        connection.close()


def test_identifiers_are_returned_and_servers_count(served):
    path = "/api/v1/rotator/0/connected?ClientID=123456&ClientTransactionID=67890"
    numbers = []
    for name in (path, path.replace("ClientID", "clientid"), f"{path}&extra=1",
                 path.replace("ClientTransactionID", "CLIENTTRANSACTIONID")):  # fmt: skip
        status, answered = ask(served, "GET", name)
        assert (status, answered["ClientTransactionID"]) == (200, 67890)
        assert (answered["ErrorNumber"], answered["ErrorMessage"]) == (0, "")
        numbers.append(answered["ServerTransactionID"])
    assert numbers[0] >= 1
    assert numbers == sorted(set(numbers))
    assert ask(served, "GET", "/api/v1/rotator/0/name")[1]["ClientTransactionID"] == 0


MALFORMED_GETS = [
    "/api/v1/ROTATOR/0/description",
    "/api/v1/baddevicetype/0/description",
    "/api/v1/rotator/-1/description",
    "/api/v1/rotator/99999/description",
    "/api/v1/rotator/A/description",
    "/api/v1/rotator/0/descrip",
    "/api/v1/rotator/0/Description",
    "/api/v2/rotator/0/description",
    "/apb/v1/rotator/0/description",
    "/api/v1/rotator/0/halt",
    "/api/v1/rotator/0",
    "/management/v2/description",
    *(
        f"/api/v1/rotator/0/connected?{name}={value}"
        for name in ("ClientID", "ClientTransactionID")
        for value in ("", "%20%20", "-12345", "NASDAQ", "4294967296", "1.5")
    ),
]
MALFORMED_PUTS = [
    ("rotator/0/connected", "Connected="),
    ("rotator/0/connected", "Connected=123456"),
    ("rotator/0/connected", "Connected=asdqwe"),
    ("rotator/0/connected", "connected=True"),
    ("rotator/0/connected", ""),
    ("rotator/0/moveabsolute", "position=10"),
    ("rotator/0/moveabsolute", "Position=ten"),
    ("rotator/0/moveabsolute", "Position=nan"),
    ("rotator/0/moveabsolute", "Position=1e999"),
    ("rotator/0/moveabsolute", "Position=10,5"),
    ("rotator/0/moveabsolute", "Position=%ff"),
    ("telescope/0/slewtoaltazasync", "Azimuth=10"),
    ("telescope/0/slewtoaltazasync", "Azimuth=10&altitude=10"),
    ("telescope/0/moveaxis", "Axis=1.5&Rate=1"),
    ("telescope/0/tracking", "Tracking=2"),
    ("telescope/0/findhomes", ""),
    ("telescope/0/azimuth", "Azimuth=10"),
]


def test_a_malformed_get_has_status_400(served):
    for path in MALFORMED_GETS:
        status, text = ask(served, "GET", path)
        assert (path, status) == (path, 400)
        assert 0 < len(text.splitlines()[0]) < 200


def test_a_malformed_put_has_status_400_and_moves_nothing(served, daemon):
    before = daemon.device().motion_number
    for member, body in MALFORMED_PUTS:
        status, _ = ask(served, "PUT", f"/api/v1/{member}", body)
        assert (member, body, status) == (member, body, 400)
    assert daemon.device().motion_number == before


@pytest.mark.parametrize("headers", [
    {"Host": "elsewhere.example:{port}"},
    {"Host": "elsewhere.example:{port}", "Origin": "http://elsewhere.example:{port}"},
    {"Host": "127.0.0.1:{port}", "Origin": "http://elsewhere.example"},
    {"Host": "127.0.0.1:{port}", "Origin": "null"},
])  # fmt: skip
def test_a_page_from_elsewhere_moves_nothing_and_learns_nothing(served, daemon, headers):
    """Any web page can make a browser send requests to this machine."""
    before, port = daemon.device().motion_number, served.address.rpartition(":")[2]
    headers = {name: value.format(port=port) for name, value in headers.items()}
    for verb, path, body in (
        ("PUT", "/api/v1/telescope/0/slewtoaltazasync", "Azimuth=40&Altitude=20"),
        ("GET", "/api/v1/telescope/0/azimuth", None),
        ("GET", "/setup", None),
    ):
        with http_connection(served) as connection:
            connection.request(verb, path, body, headers)
            answered = connection.getresponse()
            assert (path, answered.status) == (path, 403)
            answered.read()
    assert daemon.device().motion_number == before


def test_a_server_forgets_the_clients_that_were_silent_for_longest(served):
    """A program that ends without disconnecting comes back with another number."""

    def is_connected(client):
        query = urlencode({"ClientID": client})
        return ask(served, "GET", f"/api/v1/rotator/0/connected?{query}")[1]["Value"]

    for client in range(1, 41):
        ask(served, "PUT", "/api/v1/rotator/0/connected", f"Connected=True&ClientID={client}")
        assert is_connected(1)
    assert not is_connected(2)
    assert is_connected(40)


def test_management_describes_the_devices(served):
    assert management.apiversions(served.address) == [1]
    assert management.description(served.address)["ServerName"] == "orientd"
    telescope, rotator = management.configureddevices(served.address)
    assert (telescope["DeviceType"], rotator["DeviceType"]) == ("Telescope", "Rotator")
    assert telescope["UniqueID"] != rotator["UniqueID"]
    with http_connection(served) as connection:
        connection.request("GET", "/setup/v1/telescope/0/setup")
        answered = connection.getresponse()
        assert (answered.status, b"orientd" in answered.read()) == (200, True)


@contextlib.contextmanager
def http_connection(served):
    connection = http.client.HTTPConnection(served.address, timeout=30.0)
    try:
        yield connection
    finally:
        connection.close()


def malformed(generator):
    """Return verb, path and body of a request that no device can carry out."""
    verb = generator.choice(["GET", "PUT"])
    members = {"GET": ["azimuth", "slewing"], "PUT": ["slewtoaltazasync", "moveaxis", "park"]}
    kind, device, member = "telescope", "0", generator.choice(members[verb])
    good = {"slewtoaltazasync": {"Azimuth": 90, "Altitude": 10}, "moveaxis": {"Axis": 0, "Rate": 5}}
    fields = {"ClientID": 9, "ClientTransactionID": 9, **good.get(member, {})}
    junk = "".join(chr(generator.randrange(33, 0x250)) for _ in range(generator.randrange(1, 40)))
    what = generator.randrange(6)
    if what == 0:
        kind = generator.choice(["", "Telescope", "camera", "..", "tele%00scope"])
    elif what == 1:
        device = generator.choice(["1", "-1", "", "x", "9" * 30, "0.0"])
    elif what == 2:
        member = generator.choice([member.upper(), f"{member}x", "", "%2e%2e", "a" * 300])
    elif what == 3:
        fields[generator.choice(["ClientID", "ClientTransactionID"])] = generator.choice(
            ["", "-1", junk, "1e3", "NaN", "9" * 20]
        )
    elif what == 4 and member in good:
        fields.pop(generator.choice(list(good[member])))
    elif member in good:
        name = generator.choice(list(good[member]))
        fields[name] = generator.choice(["", junk, "inf", "-", "0x10", "1_0", "1 2", "\x00"])
    else:
        device = "7"
    return verb, f"/api/v1/{kind}/{device}/{member}", urlencode(fields)


@pytest.mark.real
def test_ten_thousand_malformed_requests_change_nothing(served, daemon):
    generator = random.Random(11)
    before, direction = daemon.device().motion_number, served.direction()
    with http_connection(served) as connection:
        for _ in range(9_500):
            verb, path, text = malformed(generator)
            path, body = (f"{path}?{text}", None) if verb == "GET" else (path, text)
            connection.request(verb, path, body)
            answered = connection.getresponse()
            answered.read()
            assert answered.status == 400, (verb, path, body)
    host, _, port = served.address.partition(":")
    for _ in range(500):
        with socket.create_connection((host, int(port)), timeout=30.0) as client:
            junk = generator.randbytes(generator.randrange(1, 200))
            head = generator.choice([b"", PARK, b"BREW / HTTP/1.1\r\n", b"GET / HTTP/9.9\r\n"])
            client.sendall(head + junk + b"\r\n\r\n")
            client.shutdown(socket.SHUT_WR)
            answer = b""
            with contextlib.suppress(ConnectionError):
                while piece := client.recv(4096):
                    answer += piece
            assert b" 200 " not in answer[:20]
    assert daemon.device().motion_number == before
    assert served.direction() == pytest.approx(direction, abs=1e-6)
    served.slew(10.0, 5.0)


def test_discovery_tells_the_port(daemon):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        free = probe.getsockname()[1]
    with alpaca(daemon, "--discovery", free) as served:
        known, discovery.port = discovery.port, free
        try:
            assert served.address in discovery.search_ipv4(numquery=1, timeout=1)
        finally:
            discovery.port = known
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.settimeout(30.0)
            for junk in (b"", b"x" * 500, b"alpacadiscover"):
                client.sendto(junk, ("127.0.0.1", free))
            client.sendto(b"alpacadiscovery1", ("127.0.0.1", free))
            port = int(served.address.partition(":")[2])
            assert json.loads(client.recv(1024)) == {"AlpacaPort": port}


def test_a_discovery_port_in_use_is_one_clear_line(daemon):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        port = taken.getsockname()[1]
        done = orientd(
            "serve", "alpaca", "--port", 0, "--discovery", port, "--socket", daemon.socket
        )
    assert_refused(done, f"UDP port {port} is in use", "--discovery")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_its_end_brings_a_tracking_device_to_rest(daemon, number):
    with alpaca(daemon) as served:
        served.connect().telescope.MoveAxis(PRIMARY, 20.0)
        until(lambda: daemon.device().state == pb.STATE_TRACKING, "the axis to move")
        silent = socket.create_connection(served.address.split(":"))
        served.process.send_signal(number)
        served.process.wait(30.0)
        silent.close()
        assert daemon.device().state == pb.STATE_HOLDING


@pytest.mark.real
def test_a_restart_of_the_daemon_needs_no_restart_of_the_server(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with alpaca(daemon) as served:
            served.connect().slew(20.0, 10.0)
            served.telescope.MoveAxis(PRIMARY, 10.0)
            daemon.end()
            # The server may connect and take the lease as soon as the daemon is ready.
            daemon.start(takes_lease=False)
            until(lambda: answers(served), "the server to connect to the daemon again")
            assert not served.telescope.Slewing
            served.slew(40.0, 5.0)
            assert served.direction() == pytest.approx((40.0, 5.0), abs=CLOSE)
            assert is_near(served.rotator.Position, 0.0)


def answers(served):
    try:
        served.direction()
    except exceptions.DriverException:
        return False
    return True


def test_a_daemon_that_is_gone_is_a_driver_error(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with alpaca(daemon) as served:
            served.connect()
            daemon.end()
            with pytest.raises(exceptions.DriverException, match="no daemon answers"):
                served.telescope.SlewToAltAzAsync(10.0, 10.0)
