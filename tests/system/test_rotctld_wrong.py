"""Wrong commands of antenna programs, and ranges: those that are announced are kept."""

import time

import pytest
from harness import Lines
from rotator import Client, rotctld

pytestmark = pytest.mark.world


@pytest.fixture(scope="module")
def served(daemon):
    with rotctld(daemon) as client:
        lines = Lines(client.server.stdout)
        yield client.port, lines
        client.server.stdout = None
    lines.close()


WRONG = {
    "decimal point lost in the azimuth": (
        "P 24435 20",
        "RPRT -1",
        "set_pos 24435 20: expected an azimuth from -180 to 540 degrees, got 24435; "
        "--azimuth sets the range",
    ),
    "decimal point lost in the elevation": (
        "P 244.35 -2443.5",
        "RPRT -1",
        "set_pos 244.35 -2443.5: expected an elevation from -90 to 90 degrees, got -2443.5; "
        "--elevation sets the range",
    ),
    "elevation of a rotator that flips": (
        "P 10 100",
        "RPRT -1",
        "set_pos 10 100: expected an elevation from -90 to 90 degrees, got 100; "
        "--elevation sets the range",
    ),
    "words for angles": (
        "P north 20",
        "RPRT -1",
        "set_pos north 20: expected a number as in 12.5, got 'north'",
    ),
    "not a number": (
        "P nan 20",
        "RPRT -1",
        "set_pos nan 20: expected a number as in 12.5, got 'nan'",
    ),
    "degrees and minutes": (
        "P 10:30 20:15",
        "RPRT -1",
        "set_pos 10:30 20:15: expected a number as in 12.5, got '10:30'",
    ),
    "one angle only": (
        "P 120",
        "RPRT -1",
        "set_pos: expected 2 values, got 1; give them in the line of the command",
    ),
    "unknown direction": (
        "M NORTH 20",
        "RPRT -1",
        "move NORTH 20: expected a direction, one of UP, DOWN, LEFT, RIGHT, UP_LEFT, UP_RIGHT, "
        "DOWN_LEFT, DOWN_RIGHT, or its number, got 'NORTH'",
    ),
    "speed above the limit": (
        "M RIGHT 150",
        "RPRT -1",
        "move RIGHT 150: expected a speed from 1 to 100 percent, or -1 for no change, got 150",
    ),
    "command of a radio": (
        "F 145000000",
        "RPRT -1",
        "'F': unknown command, expected one of P, p, K, S, R, M, _, s, 1, dump_state, q",
    ),
    "misspelt long name": (
        "\\set_position 10 20",
        "RPRT -1",
        "'\\\\set_position': unknown command, expected one of P, p, K, S, R, M, _, s, 1, "
        "dump_state, q",
    ),
    "level of another rotator": (
        "V SPEED 5",
        "RPRT -11",
        "'V': not served: a device has no levels, functions or parameters; leave it out",
    ),
    "long name without a backslash": (
        "set_pos 10 20",
        "RPRT -1",
        "set_pos: a long name needs a backslash; write \\set_pos",
    ),
    "reset by a word": (
        "R all",
        "RPRT -1",
        "reset all: expected the number of a reset, such as 1 for all, got 'all'",
    ),
    "reset of nothing": (
        "R",
        "RPRT -1",
        "reset: expected 1 value, got 0; give them in the line of the command",
    ),
    "sign of degrees": (
        "P 10° 20°",
        "RPRT -1",
        "set_pos 10° 20°: expected a number as in 12.5, got '10°'",
    ),
    "two decimal commas": (
        "P 10,5,3 20",
        "RPRT -1",
        "set_pos 10,5,3 20: expected a number as in 12.5, got '10,5,3'",
    ),
    "angle beyond all numbers": (
        "P 1e999 0",
        "RPRT -1",
        "set_pos 1e999 0: expected a number as in 12.5, got '1e999'",
    ),
    "semicolon between the angles": (
        "P 10;20",
        "RPRT -1",
        "set_pos: expected 2 values, got 1; give them in the line of the command",
    ),
    "direction without a number": (
        "M 99 20",
        "RPRT -1",
        "move 99 20: expected a direction, one of UP, DOWN, LEFT, RIGHT, UP_LEFT, UP_RIGHT, "
        "DOWN_LEFT, DOWN_RIGHT, or its number, got '99'",
    ),
    "backwards by a negative speed": (
        "M UP -5",
        "RPRT -1",
        "move UP -5: expected a speed from 1 to 100 percent, or -1 for no change, got -5",
    ),
    "command that is left out": (
        "+",
        "RPRT -1",
        "expected a command after '+'",
    ),
    "line without an end": (
        "S" * 2000,
        "RPRT -1",
        "a line of more than 1024 bytes; end each command with a line feed",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_command_is_answered_by_its_code_and_printed_with_its_value(served, name):
    port, lines = served
    line, code, said = WRONG[name]
    client = Client(port)
    before = client.position()
    time.sleep(0.25)  # a few lines a second
    assert client.ask(line) == [code]
    lines.await_line(said)
    client.close()
    client = Client(port)
    assert client.position() == before
    client.close()


def ranges_of(client):
    """Return the announced ranges: azimuth and elevation, degrees."""
    settings = dict(
        line.split("=") for line in client.ask("\\dump_state", 9) if line.count("=") == 1
    )
    return [
        (float(settings[f"min_{angle}"]), float(settings[f"max_{angle}"])) for angle in ("az", "el")
    ]


def assert_inside(client, seconds):
    """Ask for the position again and again; return the last one."""
    (west, east), (low, high) = ranges_of(client)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        place = client.position()
        assert west <= place[0] <= east, place
        assert low <= place[1] <= high, place
    return place


@pytest.mark.parametrize(
    ("options", "begin", "move", "edge"),
    [
        (("--azimuth", "0:180", "--elevation", "0:90"), "P 150 30", "M RIGHT 40", (180.0, 30.0)),
        (("--azimuth", "0:180", "--elevation", "0:90"), "P 30 30", "M LEFT 40", (0.0, 30.0)),
        (("--azimuth", "0:180", "--elevation", "0:90"), "P 90 20", "M DOWN 40", (90.0, 0.0)),
        (("--elevation", "0:180"), "P 0 150", "M UP 40", (0.0, 180.0)),
        (("--azimuth", "90:270", "--elevation", "0:90"), "P 180 45", "K", (90.0, 0.0)),
    ],
)
def test_moves_and_park_end_at_the_announced_edge(daemon, options, begin, move, edge):
    with rotctld(daemon, *options) as client:
        assert client.ask(begin) == ["RPRT 0"]
        client.await_position(*map(float, begin.split()[1:]))
        assert client.ask(move) == ["RPRT 0"]
        assert_inside(client, 2.0)
        client.await_position(*edge)
        # At the edge there is nothing left to turn.
        assert client.ask(move) == ["RPRT 0"]
        assert assert_inside(client, 0.5) == pytest.approx(edge, abs=0.05)


def test_positions_are_answered_in_the_announced_ranges_during_moves(daemon):
    """A flipping rotator that turns left of north in the middle of a park."""
    with rotctld(daemon, "--elevation", "0:180") as client:
        assert client.ask("P 170 80") == ["RPRT 0"]
        client.await_position(170.0, 80.0)
        assert client.ask("K") == ["RPRT 0"]
        assert_inside(client, 0.3)
        assert client.ask("M 8 20") == ["RPRT 0"]
        assert_inside(client, 2.0)
        assert client.ask("S") == ["RPRT 0"]
        assert_inside(client, 0.5)


def test_a_device_stays_in_the_announced_ranges_on_its_way(daemon):
    """The shorter way between some of these positions is through north."""
    with rotctld(daemon, "--azimuth", "0:270", "--elevation", "0:60") as client:
        assert client.ask("P 5 2") == ["RPRT 0"]
        client.await_position(5.0, 2.0)
        for azimuth, elevation in ((265.0, 2.0), (5.0, 59.0), (230.0, 1.0), (270.0, 60.0)):
            assert client.ask(f"P {azimuth} {elevation}") == ["RPRT 0"]
            assert_inside(client, 3.0)
            client.await_position(azimuth, elevation)
