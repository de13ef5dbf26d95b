"""A client library that fails, refuses or falls behind, between a driver and its robot."""

import time

import pytest
from arms import RTDEReceiveInterface
from ur_rig import driver_of, stream_of

from emulated_dynamixel import ManualClock
from orientd.errors import DeviceFaultError, FeedbackError, LinkError, SpentLinkError
from orientd_ur import UrDriver

pytestmark = pytest.mark.world


def control(stream):
    """Return the library's controlling connection; a test may replace its methods."""
    return stream.driver._link._control


class Untouched:
    """A connection of the library, or a method, that nobody may use."""

    def __getattr__(self, name):
        raise AssertionError(f"{name} was called")

    def __call__(self, *_):
        raise AssertionError("it was called")


def fails(*_):
    raise RuntimeError("Timeout connecting\nto UR dashboard server.")


# A link that is lost


def lose_packages(robot, _stream, _monkeypatch):
    robot.ask("drop receive")


def lose_control(robot, _stream, _monkeypatch):
    robot.ask("drop control")


def lose_time(robot, _stream, _monkeypatch):
    robot.ask("freeze")


def fail_once(_robot, stream, _monkeypatch):
    control(stream).servoL = fails


def reconnect(_robot, _stream, monkeypatch):
    monkeypatch.setattr("orientd_ur.link.are_open", lambda _: False)


def reconnect_slowly(_robot, stream, monkeypatch):
    reconnect(_robot, stream, monkeypatch)
    control(stream).servoL = lambda *_: time.sleep(0.021) or True


@pytest.mark.parametrize(
    ("lose", "longest", "words"),
    [
        (lose_packages, 0.1, "closed the connection$"),
        (lose_control, 0.1, "closed the connection$"),
        (lose_time, 0.6, "has stood still for 0.5"),
        (fail_once, 0.01, "Timeout connecting to UR dashboard server"),
        (reconnect, 1.1, "closed the connection, and the library made another"),
        (reconnect_slowly, 0.03, "closed the connection, and the library made another"),
    ],
)
def test_lost_link_is_found_in_time_and_never_touched_again(
    ur_robot, monkeypatch, lose, longest, words
):
    with stream_of(ur_robot.host, feedback_timeout=0.5, link_timeout=0.5) as stream:
        stream.run(0.02)
        lose(ur_robot, stream, monkeypatch)
        begun = time.monotonic()
        with pytest.raises(SpentLinkError, match=words):
            stream.step_for(2.0)
        assert time.monotonic() - begun < longest
        monkeypatch.setattr(stream.driver._link, "_control", Untouched())
        monkeypatch.setattr(stream.driver._link, "_receive", Untouched())
        for call in (stream.driver.read, stream.send, stream.driver.reset):
            with pytest.raises(SpentLinkError, match="was lost"):
                call()
        stream.driver.disable()
        stream.driver.close()


def test_link_that_is_lost_while_the_program_is_awaited_is_said_to_be_lost(ur_robot):
    with stream_of(ur_robot.host) as stream:
        stream.driver.disable()
        ur_robot.ask("stop")
        time.sleep(0.02)
        control(stream).reuploadScript = lambda: ur_robot.ask("drop receive")
        with pytest.raises(SpentLinkError, match="closed the connection"):
            stream.driver.enable()


# Packages that do not come


def test_controller_that_sends_nothing_is_not_opened_nor_enabled(ur_robot, monkeypatch):
    with driver_of(ur_robot.host) as driver:
        monkeypatch.setattr(RTDEReceiveInterface, "getTimestamp", lambda _: 100.0, raising=False)
        with pytest.raises(FeedbackError, match="sends no data packages"):
            driver.enable()
    with pytest.raises(SpentLinkError, match="sends no data packages"), driver_of(ur_robot.host):
        pass


def test_machine_that_is_too_busy_for_the_packages_is_named(ur_robot, monkeypatch):
    words = r"arrived \d+ ms ago, so this machine was too busy to take it in"
    with stream_of(ur_robot.host, feedback_timeout=0.1) as stream:
        stream.run(0.1)
        last = stream.driver._link.timestamp()
        monkeypatch.setattr(RTDEReceiveInterface, "getTimestamp", lambda _: last, raising=False)
        with pytest.raises(FeedbackError, match=words):
            stream.read_for(0.2)


def test_speed_is_a_share_whatever_the_controller_says(ur_robot, monkeypatch):
    with stream_of(ur_robot.host) as stream:
        for said, share in ((2.0, 1.0), (-1.0, 0.0)):
            monkeypatch.setattr(
                RTDEReceiveInterface, "getSpeedScaling", lambda _, said=said: said, raising=False
            )
            stream.run(0.01)
            assert stream.driver.speed_scaling == share


# Orders and setpoints that are refused


def test_order_that_the_program_does_not_carry_out_is_a_fault_in_words(ur_robot):
    with stream_of(ur_robot.host) as stream:
        control(stream).setWatchdog = lambda _: False
        with pytest.raises(DeviceFaultError, match="did not carry out setWatchdog"):
            stream.driver.enable()

        def stopped(_):
            ur_robot.ask("protective_stop")
            time.sleep(0.02)
            return False

        control(stream).setWatchdog = stopped
        with pytest.raises(DeviceFaultError, match="protective stop: look for its cause"):
            stream.driver.enable()


def test_setpoint_that_is_not_taken_is_a_fault_with_its_reason_if_there_is_one(ur_robot):
    with stream_of(ur_robot.host) as stream:
        control(stream).servoL = lambda *_: False
        with pytest.raises(DeviceFaultError, match="takes no setpoints"):
            stream.send()
        # The state that explains it comes a little later.
        control(stream).servoL = lambda *_: ur_robot.ask("pause") == ""
        with pytest.raises(DeviceFaultError, match="paused"):
            stream.send()


@pytest.mark.parametrize("order", ["protective_stop", "pause", "emergency_stop"])
def test_robot_that_takes_no_orders_is_given_none_when_it_is_disabled(ur_robot, order):
    with stream_of(ur_robot.host) as stream:
        ur_robot.ask(order)
        time.sleep(0.02)
        control(stream).servoStop = Untouched()
        stream.driver.disable()


def test_program_is_uploaded_only_once_the_controller_holds_no_command(ur_robot):
    with stream_of(ur_robot.host) as stream:
        stream.run(0.02)
        ur_robot.ask("stop")
        stream.driver.reset()
        stream.start()
        stream.run(0.02)
        ur_robot.ask("stop")
        control(stream).kickWatchdog = lambda: True
        control(stream).reuploadScript = Untouched()
        words = "holds the command 24 in input_int_register_0"
        with pytest.raises(DeviceFaultError, match=words):
            stream.driver.reset()


def test_reset_that_cannot_play_says_so(ur_robot):
    with stream_of(ur_robot.host) as stream:
        control(stream).reuploadScript = lambda: True
        words = "does not play the control program; is it in remote control"
        with pytest.raises(DeviceFaultError, match=words):
            stream.driver.reset()


# The arm


def test_arm_is_none_or_the_named_one_if_the_controller_does_not_say(ur_robot, monkeypatch):
    def silent(*_):
        raise LinkError("it does not say")

    monkeypatch.setattr("orientd_ur.robot.ask", silent)
    with stream_of(ur_robot.host) as stream:
        assert stream.driver.mechanism(may_ask=True) is None
    with stream_of(ur_robot.host, model="ur10e") as stream:
        assert stream.driver.mechanism(may_ask=True).name == "ur10e"


def test_end_of_the_process_is_explained_by_its_signal():
    driver = UrDriver({"host": "127.0.0.9"}, period_ns=2_000_000, clock=ManualClock(1))
    assert "see what the controller at 127.0.0.9 sends" in driver.why_ended(6)
    assert "took more than 0.9 s" in driver.why_ended(14)
    assert "when the controller at 127.0.0.9 closes a connection" in driver.why_ended(11)
    assert driver.why_ended(9) == driver.why_stale() == ""
    assert (driver.default_rate_hz, driver.longest_call) == (500.0, 0.9)
    assert driver.deadline_shift_ns(0) == 0
