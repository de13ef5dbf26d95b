"""The options: the example deployment loads, and what is wrong is named."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emulated_dynamixel import MODELS as EMULATED
from emulated_dynamixel import EmulatedServo
from orientd import config
from orientd_dynamixel.options import parse
from orientd_dynamixel.tables import MODELS

EXAMPLE = Path(__file__).parents[3] / "config" / "gimbal.toml"
GOOD = {"port": "/dev/null", "axes": [{"id": 1}, {"id": 2}, {"id": 3}]}


def test_example_deployment_is_well_formed():
    table = tomllib.loads(EXAMPLE.read_text())
    options = parse(table["devices"]["gimbal"]["options"])
    assert [axis.name for axis in options.axes] == ["yaw", "pitch", "roll"]
    assert options.axes[0].high == pytest.approx(math.radians(270))


def test_example_deployment_is_read_by_the_daemon():
    settings = config.load(EXAMPLE)
    assert settings.devices["gimbal"].driver == "dynamixel"


def test_axis_takes_eighty_percent_of_the_speed_without_load():
    assert parse(GOOD).axes[0].velocity == pytest.approx(0.8 * 46 * math.tau / 60)


def test_gear_makes_an_axis_slower():
    yaw, pitch, _ = parse({**GOOD, "axes": [{"id": 1, "gear": 2.0}, {"id": 2}, {"id": 3}]}).axes
    assert yaw.velocity == pytest.approx(pitch.velocity / 2)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("watchdog_ms", 0, 2540),
        ("roll_tolerance_deg", 0, 180),
        ("follow_tolerance_deg", 0.1, 360),
        ("arrival_tolerance_deg", 0.1, 360),
        ("follow_time", 0.01, 10),
        ("max_losses", 1, 1000),
        ("latency_ms", 0.1, 1000),
        ("max_deviation_deg", 0, 45),
        ("on_target_deg", 0.001, 45),
    ],
)
def test_numbers_are_within_their_ranges(name, least, most):
    settings = parse(GOOD)
    for value in (least, most):
        taken = getattr(parse({**GOOD, name: value}), name.removesuffix("_deg"))
        assert taken == pytest.approx(math.radians(value) if name.endswith("_deg") else value)
    for value in (least - 0.05, most + 0.05):
        with pytest.raises(ValueError, match=f"{name} must be a number from"):
            parse({**GOOD, name: value})
    assert hasattr(settings, name.removesuffix("_deg"))


def test_defaults_are_those_of_the_documentation():
    settings = parse(GOOD)
    assert (settings.watchdog_ms, settings.max_losses, settings.latency_ms) == (500, 10, 16.0)
    assert (settings.follow_time, settings.max_deviation, settings.allow_slews) == (0.3, 0.0, False)
    angles = (settings.roll_tolerance, settings.follow_tolerance, settings.arrival_tolerance)
    assert np.rad2deg(angles) == pytest.approx([1.0, 15.0, 2.0])
    assert np.rad2deg(settings.on_target) == pytest.approx(0.5)
    assert (settings.baud, settings.order, settings.at_end) == (1_000_000, "ZYX", "release")
    assert (settings.fast_read, settings.turns_file, settings.park) == ("auto", None, None)
    assert (settings.pointing, settings.overwrite) == (False, frozenset())
    axis = settings.axes[0]
    assert np.rad2deg([axis.low, axis.high, axis.zero]) == pytest.approx([-180, 180, 0])
    assert (axis.gear, axis.direction, axis.acceleration) == (1.0, 1, pytest.approx(40.0))
    assert parse({**GOOD, "order": "ZY", "axes": [{"id": 0}, {"id": 252}]}).pointing is True


@pytest.mark.parametrize(
    ("name", "least", "most", "beyond"),
    [
        ("gear", 1e-3, 1e3, (9e-4, 1001)),
        ("acceleration_deg", 1.0, 1e5, (0.9, 1.1e5)),
        ("current_limit", 0.00269, 4, (0.0026, 4.01)),
        ("velocity_deg", 0.1, 275.9, (0.0, 276.1)),
        ("id", 0, 252, (-1, 253)),
    ],
)
def test_numbers_of_an_axis_are_within_their_ranges(name, least, most, beyond):
    def axis(value):
        row = {"id": 1, "limits_deg": [-0.01, 0.01], name: value}
        return parse({**GOOD, "axes": [row, {"id": 5}, {"id": 6}]}).axes[0]

    for value in (least, most):
        assert axis(value)
    for value in beyond:
        with pytest.raises(ValueError, match=rf"axes\[0\].{name}"):
            axis(value)


def test_two_axes_about_the_same_letter_have_different_names():
    assert [axis.name for axis in parse({**GOOD, "order": "ZYZ"}).axes] == ["z", "y", "z2"]


@pytest.mark.parametrize("gear", [1.0, 2.5])
def test_an_endless_axis_goes_as_far_as_its_servo_counts(gear):
    axis = {"id": 1, "limits_deg": "endless", "zero_deg": 10, "gear": gear}
    yaw = parse({**GOOD, "axes": [axis, *GOOD["axes"][1:]]}).axes[0]
    assert np.rad2deg([yaw.low, yaw.high]) == pytest.approx(
        [10 - 91_800 / gear, 10 + 91_800 / gear]
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"prot": 1}, "unknown option 'prot'"),
        ({"port": ""}, "port must be the path"),
        ({"baud": 4_500_000}, "baud must be one of 9600"),
        ({"order": "ZZX"}, "order must be two or three"),
        ({"order": "ZY"}, "axes must be 2 tables"),
        ({"axes": [{"id": 1}, {"id": 1}, {"id": 3}]}, "axes must have different ids"),
        (
            {"axes": [{"id": 1, "name": "x"}, {"id": 2}, {"id": 3}]},
            r"axes must have different names, got \['x', 'y', 'x'\]",
        ),
        ({"axes": [{"id": 1}, {"id": 300}, {"id": 3}]}, r"axes\[1\].id must be a whole number"),
        ({"axes": [{"id": 1, "modle": 1}, {}, {}]}, r"unknown option 'axes\[0\].modle'"),
        ({"axes": [{"id": 1, "model": "ax12"}, {}, {}]}, r"axes\[0\].model must be one of xm430"),
        ({"axes": [{"id": 1, "velocity_deg": 400}, {}, {}]}, "without load, got 400"),
        ({"axes": [{"id": 1, "limits_deg": [5, 1]}, {}, {}]}, "the lower angle first"),
        ({"axes": [{"id": 1, "limits_deg": [-1e6, 1]}, {}, {}]}, "within 255 turns"),
        ({"axes": [{"id": 1, "direction": 2}, {}, {}]}, "direction must be one of 1, -1"),
        ({"axes": [{"id": 1, "gear": math.nan}, {}, {}]}, "gear must be a number"),
        ({"park_deg": [0, 0]}, "park_deg must be 3 numbers"),
        ({"park_deg": [0, -190, 0]}, "park_deg must be within the limits of y, got"),
        ({"park_deg": 3}, "park_deg must be 3 numbers, got 3"),
        ({"turns_file": 3}, "turns_file must be a path, or empty for none, got 3"),
        ({"port": 3}, "port must be the path of a serial port, got 3"),
        ({"order": 3}, "order must be two or three"),
        ({"order": "Z"}, "order must be two or three"),
        ({"order": "ZYXZ"}, "order must be two or three"),
        ({"order": "ZYA"}, "order must be two or three"),
        ({"axes": 3}, "axes must be 3 tables, one for each of ZYX, got 3"),
        ({"axes": [{"id": 1}, 3, {"id": 2}]}, r"axes\[1\] must be a table, got 3"),
        ({"axes": [{"id": 1, "name": ""}, {}, {}]}, r"axes\[0\].name must be a text"),
        ({"axes": [{"id": 1, "limits_deg": [5, 5]}, {}, {}]}, "the lower angle first"),
        ({"axes": [{"id": 1, "limits_deg": [0, 91_801]}, {}, {}]}, "within 255 turns"),
        ({"overwrite": "drive_mode"}, "overwrite must be true, false or a list"),
        ({"park_deg": [0, 0, 190]}, "park_deg must be within the limits of x, got .*190"),
        ({"overwrite": [["drive_mode"]]}, "overwrite must be true, false or a list"),
        ({"at_end": "drop"}, "at_end must be one of release, hold"),
        ({"fast_read": True}, "fast_read must be one of auto, on, off"),
        ({"mount": {"w": 2, "x": 0, "y": 0, "z": 0}}, "mount must have norm 1"),
        ({"watchdog_ms": -1}, "watchdog_ms must be a number from 0 to 2540"),
    ],
)
def test_what_is_wrong_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        parse({**GOOD, **change})


@pytest.mark.parametrize("name", EMULATED)
def test_every_model_is_driven_on_a_bus_of_its_own(rig, name):
    it = rig("ZY", models=[name, name])
    it.start()
    it.run(30, lambda k: [0.004 * k, -0.002 * k])
    it.run(40)
    assert it.seen[-1].joints == pytest.approx((0.116, -0.058), abs=0.002)


class HighServo(EmulatedServo):
    """A servo whose registers that are not permanent lie 448 bytes higher, as in the P series.

    Its shaft has as many ticks a turn as the others.
    """

    def read(self, address, count, now_ns):
        error, content = super().read(self.low(address), count, now_ns)
        if 168 <= address < 512:
            content = self.shifted(content, 448)
        return error, content

    def write(self, address, content, now_ns):
        if 168 <= address < 512:
            assert not self.is_torque_on
            content = self.shifted(content, -448)
        return super().write(self.low(address), content, now_ns)

    def low(self, address):
        if 634 <= address < 762:
            return address - 634 + 224
        return address - 448 * (address >= 512)

    def shifted(self, content, by):
        entries = [
            int.from_bytes(content[k : k + 2], "little") + by for k in range(0, len(content), 2)
        ]
        return b"".join(entry.to_bytes(2, "little") for entry in entries)


def test_park_may_be_at_a_limit():
    parked = parse({**GOOD, "park_deg": [180, -180, 0]}).park
    assert np.rad2deg(parked) == pytest.approx([180, -180, 0])


@pytest.mark.parametrize(
    ("given", "taken"),
    [(True, {"homing_offset", "drive_mode", "operating_mode"}), (["drive_mode"], {"drive_mode"})],
)
def test_overwrite_takes_all_or_what_is_named(given, taken):
    assert parse({**GOOD, "overwrite": given}).overwrite == taken


@pytest.mark.parametrize("name", [name for name in MODELS if name not in EMULATED])
def test_every_model_of_the_p_series_is_driven_by_its_own_registers(rig, name):
    it = rig("ZY", axes=[{"id": 1, "model": name}, {"id": 2, "model": name}])
    model = replace(EMULATED["xm430"], number=MODELS[name].number)
    it.bus.servos[:] = [HighServo(k, model, now_ns=it.clock.now_ns()) for k in (1, 2)]
    for servo in it.bus.servos:
        servo.shaft.position = 0.0
    it.start()
    angles = [300 * math.tau / MODELS[name].ticks, -100 * math.tau / MODELS[name].ticks]
    it.run(60, lambda k: [angle * min(1.0, k / 50) for angle in angles])
    it.run(40)
    assert it.driver._group.lost == 0
    assert it.goals() == [300, -100]
    assert it.seen[-1].joints == pytest.approx(angles, rel=0.02)


def test_models_have_numbers_of_their_own():
    numbers = [model.number for model in MODELS.values()]
    assert len(set(numbers)) == len(numbers)
    for name, emulated in EMULATED.items():
        assert (MODELS[name].name, MODELS[name].number) == (emulated.name, emulated.number)


def test_p_series_has_no_mode_that_limits_the_current():
    axes = [{"id": 1, "model": "ph54-200", "current_limit": 0.5}, {"id": 2}]
    with pytest.raises(ValueError, match="PH54-200-S500 has no limit of its current"):
        parse({"port": "virtual", "order": "ZY", "axes": axes})


def test_a_limit_of_current_is_for_servos_that_measure_it():
    axes = [{"id": 1, "model": "xl430-w250", "current_limit": 0.5}, {"id": 2}]
    with pytest.raises(ValueError, match="XL430-W250 has no limit of its current"):
        parse({"port": "virtual", "order": "ZY", "axes": axes})
