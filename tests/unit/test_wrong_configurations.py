"""Wrong configurations: each is refused in one line with the file, the key, the value and more."""

import pytest
from command_line import inside

from orientd.config import load

DEVICE = "[devices.arm]\ndriver = 'loopback'\n"

# The file, and the line about it.
WRONG = {
    "a decimal comma": (
        DEVICE + "rate_hz = 500,5\n",
        "not TOML: Expected newline or end of document after a statement (at line 3, column 14): "
        "'rate_hz = 500,5'; write numbers with a decimal point",
    ),
    "a number in quotes": (
        DEVICE + "rate_hz = '500'\n",
        "devices.arm.rate_hz: expected a number, got the text '500' (without "
        "quotes it would be a number)",
    ),
    "a number with its unit": (
        DEVICE + "feedback_timeout = '100 ms'\n",
        "devices.arm.feedback_timeout: expected a number, got the text '100 ms' "
        "(write the number alone, without a unit)",
    ),
    "a unit without quotes": (
        DEVICE + "rate_hz = 500Hz\n",
        "not TOML: Expected newline or end of document after a statement (at line 3, column 14): "
        "'rate_hz = 500Hz'; write numbers without a unit",
    ),
    "yes for true": (
        DEVICE + "auto_enable = yes\n",
        "not TOML: Invalid value (at line 3, column 15): 'auto_enable = yes'; write true or false",
    ),
    "true in quotes": (
        DEVICE + "auto_enable = 'true'\n",
        "devices.arm.auto_enable: expected true or false, got the text 'true' "
        "(without quotes it would be one)",
    ),
    "a text without quotes": (
        "[devices.arm]\ndriver = loopback\n",
        "not TOML: Invalid value (at line 2, column 10): 'driver = loopback'; put texts in quotes",
    ),
    "YAML": (
        "devices:\n  arm:\n    driver: loopback\n",
        "not TOML: Expected '=' after a key in a key/value pair (at line 1, column 8): 'devices:'; "
        "a configuration is TOML: KEY = VALUE below [HEADING]",
    ),
    "a device twice": (
        DEVICE + DEVICE,
        "not TOML: Cannot declare ('devices', 'arm') twice (at line 3, column 13): "
        "'[devices.arm]'; give each heading once, and each device a name of its own",
    ),
    "a key twice": (
        DEVICE + "rate_hz = 500\nrate_hz = 250\n",
        "not TOML: Cannot overwrite a value (at line 4, column 14): 'rate_hz = 250'; "
        "give each key once",
    ),
    "a rate that is infinite": (
        DEVICE + "rate_hz = inf\n",
        "devices.arm.rate_hz: expected less than or equal to 4000, got inf; "
        "give a number in this range, or leave the key out for its default",
    ),
    "a device without a driver": (
        "[devices.arm]\n",
        "devices.arm.driver: missing; add this key",
    ),
    "a device that is a number": (
        "[devices]\narm = 3\n",
        "devices.arm: expected a table, got 3; write its heading as [devices.arm]",
    ),
    "a driver that is a number": (
        "[devices.arm]\ndriver = 3\n",
        "devices.arm.driver: expected a text, got 3; put it in quotes",
    ),
    "double brackets": (
        "[[devices.arm]]\ndriver = 'loopback'\n",
        "devices.arm: expected a table, got [{'driver': 'loopback'}]; "
        "write its heading in single brackets",
    ),
    "a limit in degrees": (
        DEVICE + "limits = {velocity_deg = 90}\n",
        "devices.arm.limits.velocity_deg: unknown key; did you mean 'velocity'?; known are preset, "
        "velocity, acceleration, jerk, linear_velocity, linear_acceleration",
    ),
    "a decimal point lost in a cone": (
        DEVICE + "keep_out = [{name = 'a', half_angle_deg = 5, "
        "azimuth_elevation = {azimuth = 24435, elevation = 5}}]\n",
        "devices.arm.keep_out[0].azimuth_elevation.azimuth: expected -720 to 720 deg, got 24435; "
        "check the decimal point",
    ),
    "a negative limit": (
        DEVICE + "limits = {velocity = -1}\n",
        "devices.arm.limits.velocity: expected a number greater than 0, got -1; "
        "give such a limit, or leave it out",
    ),
    "a limit beyond all devices": (
        DEVICE + "limits = {jerk = 1e99}\n",
        "devices.arm.limits.jerk: must be within 1e-09 and 1e+12 rad/s^3, got 1e+99; "
        "give a limit in this range, or leave it out",
    ),
    "an empty file": (
        "",
        "devices: expected at least one table [devices.NAME], got {}; add one",
    ),
    "a name with a space": (
        "[devices.'arm 2']\ndriver = 'loopback'\n",
        "devices.arm 2.name: expected a letter, then at most 31 letters, digits, '-' or '_', "
        "got the text 'arm 2'; choose another name",
    ),
    "a quote that is left open": (
        "[devices.arm]\ndriver = 'loopback",
        'not TOML: Expected "\'" (at end of document); close the quotes and brackets',
    ),
    "a limit twice in braces": (
        DEVICE + "limits = {velocity = 1, velocity = 2}\n",
        "not TOML: Duplicate inline table key 'velocity' (at line 3, column 37): "
        "'limits = {velocity = 1, velocity = 2}'; give each key once",
    ),
    "a cone without a name": (
        DEVICE + "keep_out = [{half_angle_deg = 20}]\n",
        "devices.arm.keep_out[0].name: missing; add this key",
    ),
    "a frame that is a number": (
        DEVICE + "frames = {table = 1}\n",
        "devices.arm.frames.table: expected a mapping, got 1; write it as {KEY: VALUE}",
    ),
    "a rate of a motor": (
        DEVICE + "rate_hz = 50000\n",
        "devices.arm.rate_hz: expected less than or equal to 4000, got 50000; "
        "give a number in this range, or leave the key out for its default",
    ),
}


# What a driver refuses, when the device is made.
WRONG_DRIVERS = {
    "a misspelt driver": (
        "[devices.arm]\ndriver = 'loopbac'\n",
        "devices.arm.driver: unknown driver 'loopbac', installed are: dynamixel, loopback, ur; "
        "did you mean 'loopback'?",
    ),
    "a driver that is not installed": (
        "[devices.arm]\ndriver = 'kuka'\n",
        "devices.arm.driver: unknown driver 'kuka', installed are: dynamixel, loopback, ur; "
        "install its package, or name one of these",
    ),
    "a misspelt option": (
        DEVICE + "options = {recrod = '/tmp/x'}\n",
        "devices.arm.options: unknown option 'recrod', allowed are: delay_cycles, fault_file, "
        "model, model_options, orientation, position, record; did you mean 'record'?; "
        "correct it below [devices.arm.options]",
    ),
    "an arm without an address": (
        "[devices.arm]\ndriver = 'ur'\n",
        "devices.arm.options: host must be the robot's address, got None; "
        "correct it below [devices.arm.options]",
    ),
}


@pytest.mark.parametrize("name", WRONG_DRIVERS)
def test_a_wrong_driver_or_option_is_refused_with_the_file(tmp_path, name):
    text, line = WRONG_DRIVERS[name]
    path, motion = tmp_path / "orientd.toml", tmp_path / "turn.yaml"
    path.write_text(text)
    motion.write_text("keyframes: [{rotation_vector: [0, 0, 1]}]")
    done = inside("plan", "--config", path, motion)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"orientd: {path}: {line}\n"


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_configuration_is_refused_with_its_key_and_value(tmp_path, name):
    text, line = WRONG[name]
    path = tmp_path / "orientd.toml"
    path.write_text(text)
    done = inside("run", "--config", path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"orientd: {path}: {line}\n"


def test_a_configuration_may_begin_with_a_byte_order_mark(tmp_path):
    path = tmp_path / "orientd.toml"
    path.write_text(DEVICE, encoding="utf-8-sig")
    assert list(load(path).devices) == ["arm"]
