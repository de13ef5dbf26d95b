"""Wrong configurations: each is refused in one line with the file, the key, the value and more."""

import pytest
from command_line import inside

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
        "devices.arm.rate_hz: expected a number, got '500' (without quotes it would be a number)",
    ),
    "a number with its unit": (
        DEVICE + "feedback_timeout = '100 ms'\n",
        "devices.arm.feedback_timeout: expected a number, got '100 ms' "
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
        "devices.arm.auto_enable: expected true or false, got 'true' "
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
        "devices.arm.rate_hz: expected a finite number, got inf; "
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
    "a rate of a motor": (
        DEVICE + "rate_hz = 50000\n",
        "devices.arm.rate_hz: expected less than or equal to 4000, got 50000; "
        "give a number in this range, or leave the key out for its default",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_configuration_is_refused_with_its_key_and_value(tmp_path, name):
    text, line = WRONG[name]
    path = tmp_path / "orientd.toml"
    path.write_text(text)
    done = inside("run", "--config", path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"orientd: {path}: {line}\n"
