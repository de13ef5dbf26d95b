import itertools

import pytest

from emulated_dynamixel import ManualClock
from orientd.driver import Setpoint, driver_target, load_driver
from orientd.errors import ConfigError
from orientd.floats import difference, exp, norm
from orientd.testing import DriverConformance
from orientd_loopback import LoopbackDriver, read_recording

PERIOD_NS = 2_000_000


class TestLoopbackConformance(DriverConformance):
    @pytest.fixture(autouse=True)
    def _place(self, tmp_path):
        self.clock = ManualClock(1)
        self.fault_file = tmp_path / "fault"

    def make_driver(self):
        options = {"delay_cycles": 3, "fault_file": str(self.fault_file)}
        return LoopbackDriver(options, period_ns=PERIOD_NS, clock=self.clock)

    def break_device(self):
        self.fault_file.write_text("link_lost")
        return True

    def pass_cycle(self, driver):
        self.clock.advance(driver.period_ns)


class TestLaggedLoopbackConformance(TestLoopbackConformance):
    settle_cycles = 300

    def make_driver(self):
        options = {
            "model": "orientd_loopback.joint:LaggedBody",
            "model_options": {"bandwidth_hz": 15.0},
        }
        options["fault_file"] = str(self.fault_file)
        return LoopbackDriver(options, period_ns=PERIOD_NS, clock=self.clock)


def make(**options):
    return LoopbackDriver(options, period_ns=PERIOD_NS, clock=ManualClock(1))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dely_cycles": 2}, "unknown option 'dely_cycles'"),
        ({"delay_cycles": -1}, "delay_cycles must be a whole number from 0 to 1000, got -1"),
        ({"delay_cycles": 1.5}, "delay_cycles must be a whole number"),
        ({"orientation": {"w": 1.1, "x": 0, "y": 0, "z": 0}}, "norm 1, got 1.1"),
        ({"orientation": [1, 0, 0, 0]}, "orientation must be {w, x, y, z}"),
        ({"position": [0, 0, float("nan")]}, "position must be 3 numbers"),
        ({"model": "orientd_loopback.joint:Nothing"}, "cannot be loaded"),
        (
            {"model": "orientd_loopback.joint:LaggedBody", "model_options": {"speed": 1}},
            "do not fit",
        ),
        ({"record": 3}, "record must be a path"),
    ],
)
def test_a_wrong_option_is_refused_in_one_line(options, message):
    with pytest.raises(ValueError, match=message.replace("{", r"\{").replace("[", r"\[")) as caught:
        make(**options)
    assert "\n" not in str(caught.value)


def test_the_recording_holds_every_setpoint(tmp_path):
    driver = make(record=str(tmp_path / "sent"))
    driver.open()
    driver.enable()
    sent = [Setpoint(k, exp((0.0, 0.001 * k, 0.0)), (0.0, 0.5, 0.0)) for k in range(50)]
    for setpoint in sent:
        driver.write(setpoint)
    # Nothing is buffered: the recording is complete even if the process is killed here.
    assert read_recording(tmp_path / "sent") == sent
    driver.close()


def test_the_lagged_body_comes_closer_by_a_constant_factor():
    driver = make(model="orientd_loopback.joint:LaggedBody", delay_cycles=0)
    driver.open()
    driver.enable()
    target = exp((0.5, 0.0, 0.0))
    gaps = []
    for _ in range(20):
        driver.write(Setpoint(0, target))
        gaps.append(norm(difference(driver.read().q, target)))
    ratios = [b / a for a, b in itertools.pairwise(gaps)]
    assert max(ratios) == pytest.approx(min(ratios))
    assert max(ratios) < 1.0


def test_noise_has_the_deviation_that_was_asked_for():
    options = {"noise": 0.01, "bandwidth_hz": 500.0, "seed": 4}
    driver = make(model="orientd_loopback.joint:LaggedBody", model_options=options, delay_cycles=0)
    driver.open()
    driver.enable()
    errors = []
    for _ in range(4000):
        driver.write(Setpoint(0, (1.0, 0.0, 0.0, 0.0)))
        errors.extend(difference((1.0, 0.0, 0.0, 0.0), driver.read().q))
    deviation = (sum(e * e for e in errors) / len(errors)) ** 0.5
    assert deviation == pytest.approx(0.01, rel=0.03)


def test_drivers_are_found_by_entry_point():
    assert driver_target("loopback") == "orientd_loopback:LoopbackDriver"
    assert load_driver("loopback") is LoopbackDriver


def test_an_unknown_driver_is_refused_with_those_that_there_are():
    with pytest.raises(ConfigError, match=r"unknown driver 'loopbak', installed are: .*loopback"):
        load_driver("loopbak")
