"""The daemon's settings: what is read, what is refused, and how it is said."""

import json
import re
from pathlib import Path

import pytest

from orientd import config
from orientd.config import Role
from orientd.errors import ConfigError

EXAMPLES = sorted((Path(__file__).parents[2] / "config").glob("*.toml"))


def write(directory: Path, text: str) -> Path:
    path = directory / "orientd.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_every_example_loads(path):
    assert config.load(path).devices


def test_the_loopback_example_says_the_defaults():
    path = next(path for path in EXAMPLES if path.name == "loopback.toml")
    example = config.load(path)
    plain = config.default_settings()
    assert example.daemon == plain.daemon
    arm = example.devices["arm"]
    arm = arm.model_copy(update={"options": {}, "limits": config.LimitSettings()})
    assert arm.model_dump() == plain.devices["arm"].model_dump()


@pytest.mark.parametrize(
    ("driver", "rate_hz"), [("dynamixel", 100.0), ("loopback", 500.0), ("not installed", 500.0)]
)
def test_a_device_has_the_rate_of_its_driver_unless_it_says_another(driver, rate_hz):
    devices = {"one": {"driver": driver}, "other": {"driver": driver, "rate_hz": 250.0}}
    found = config.parse({"devices": devices}, source="here").devices
    assert (found["one"].rate_hz, found["other"].rate_hz) == (rate_hz, 250.0)


def test_what_is_given_is_kept(tmp_path):
    settings = config.load(
        write(
            tmp_path,
            """
            [daemon]
            socket = "/run/x/control.sock"
            lease_seconds = 2
            [devices.gimbal]
            driver = "loopback"
            rate_hz = 1000
            priority = 0
            [devices.gimbal.limits]
            velocity = 1
            [devices.gimbal.options]
            anything = [1, 2]
            """,
        )
    )
    device = settings.devices["gimbal"]
    assert settings.daemon.socket == Path("/run/x/control.sock")
    assert settings.daemon.lease_seconds == 2.0
    assert (device.name, device.rate_hz, device.period_ns) == ("gimbal", 1000.0, 1_000_000)
    assert device.limits.velocity == 1.0
    assert device.limits.jerk is None
    assert device.options == {"anything": [1, 2]}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[devices]", "devices: expected at least one table [devices.NAME], got {}"),
        ("devices = 3", "devices: expected a table, got 3"),
        (
            "[devices.arm]\ndriver = 'x'\nrate_hz = -5",
            "devices.arm.rate_hz: expected greater than or equal to 1, got -5",
        ),
        (
            "[devices.arm]\ndriver = 'x'\nrate_hz = true",
            "devices.arm.rate_hz: expected a number, got true",
        ),
        (
            "[devices.arm]\ndriver = 'x'\nrat_hz = 5",
            "devices.arm.rat_hz: unknown key; did you mean 'rate_hz'?; known are driver, python, ",
        ),
        ("[devices.arm]\ndrver = 'x'", "devices.arm.drver: unknown key; did you mean 'driver'?"),
        (
            "[devices.limits]\ndriver = 'x'\nlimits = {velo = 1}",
            "devices.limits.limits.velo: unknown key; did you mean 'velocity'?; known are preset, ",
        ),
        (
            "[tcp]\nlissten = 'x:1'\n[devices.arm]\ndriver = 'x'",
            "tcp.lissten: unknown key; did you mean 'listen'?; known are ",
        ),
        (
            "[devices.arm]\ndriver = 'x'\nlimits = {velocity = nan}",
            "devices.arm.limits.velocity: expected a finite number, got nan",
        ),
        (
            "[devices.arm]\ndriver = 'x'\nname = 'y'",
            "devices.arm.name: the table's own name is the device's name",
        ),
        ("[daemon]\nsocket = 3\n[devices.arm]\ndriver = 'x'", "daemon.socket: expected a path"),
        (
            "[daemons]\n[devices.arm]\ndriver = 'x'",
            "daemons: unknown key; did you mean 'daemon'?; known are daemon, ",
        ),
        ("[devices.arm", "not TOML: "),
    ],
)
def test_a_bad_file_is_refused_in_one_line_that_names_the_key(tmp_path, text, complaint):
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        config.load(path)
    assert str(caught.value).startswith(f"{path}: {complaint}")
    assert "\n" not in str(caught.value)


@pytest.fixture
def foreign(tmp_path, monkeypatch):
    """A package that reads the table ``[lab]``, and whose import fails."""
    described = tmp_path / "foreign-1.0.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign\nVersion: 1.0\n")
    entries = "[orientd.tables]\nlab = foreign.settings:Lab\ntcp = foreign.settings:Tcp\n"
    (described / "entry_points.txt").write_text(entries)
    monkeypatch.syspath_prepend(tmp_path)


def test_a_table_that_a_package_reads_is_left_to_it(foreign):
    table = {"devices": {"arm": {"driver": "loopback"}}, "lab": {"any": ["thing"]}}
    settings = config.parse(table, source="x")
    assert settings.of_packages == {"lab": "foreign"}
    assert settings.model_dump() == config.default_settings().model_dump()


def test_a_package_takes_no_table_of_the_core_and_no_unknown_one(foreign):
    devices = {"arm": {"driver": "loopback"}}
    with pytest.raises(ConfigError, match=r"tcp\.listen: missing"):
        config.parse({"devices": devices, "tcp": {}}, source="x")
    with pytest.raises(ConfigError, match="labs: unknown key"):
        config.parse({"devices": devices, "lab": {}, "labs": {}}, source="x")


def test_a_table_that_has_moved_says_what_reads_it_if_that_is_not_installed(monkeypatch):
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: [])
    table = {"devices": {"arm": {"driver": "loopback"}}, "fleet": {}}
    with pytest.raises(ConfigError, match=r"^x: fleet: `orientd fleet serve` reads this table"):
        config.parse(table, source="x")


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read .*absent\.toml: No such file"):
        config.load(tmp_path / "absent.toml")


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "orientd.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="not UTF-8"):
        config.load(path)


def test_the_environment_names_the_file_before_the_users_directory(tmp_path, monkeypatch):
    monkeypatch.delenv("ORIENTD_CONFIG", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert config.find() is None
    (tmp_path / "orientd").mkdir()
    write(tmp_path / "orientd", "")
    assert config.find() == tmp_path / "orientd" / "orientd.toml"
    monkeypatch.setenv("ORIENTD_CONFIG", "/elsewhere.toml")
    assert config.find() == Path("/elsewhere.toml")


def led(**given):
    return config.parse({"devices": {"arm": {"driver": "loopback", **given}}}, source="x").devices[
        "arm"
    ]


def test_lead_is_a_number_or_the_latency_that_was_found():
    assert led().lead == 0.0
    assert led(latency=0.1).lead == 0.0
    assert led(compensate_latency=0.08, latency=0.1).lead == 0.08
    assert led(compensate_latency=True, latency=0.1).lead == 0.1


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"compensate_latency": True}, "compensate_latency: true needs latency"),
        ({"compensate_latency": -0.1}, "expected a number of seconds from 0 to 1, or true"),
        ({"compensate_latency": "0.1"}, "got the text '0.1'"),
        ({"compensate_latency": float("nan")}, "got nan"),
        ({"latency": True}, "devices.arm.latency: expected a number of seconds from 0 to 1, got"),
    ],
)
def test_lead_that_is_not_allowed_is_refused(given, complaint):
    with pytest.raises(ConfigError) as caught:
        led(**given)
    assert complaint in str(caught.value)


def limits_of(tmp_path, table):
    text = f"[devices.arm]\ndriver = 'x'\nlimits = {{{table}}}"
    return config.load(write(tmp_path, text)).devices["arm"].limits.to_limits()


def phases(*devices):
    table = {f"arm{k}": {"driver": "loopback", **device} for k, device in enumerate(devices)}
    found = config.parse({"devices": table}, source="test").devices
    return [device.phase for device in found.values()]


@pytest.mark.parametrize("count", [1, 2, 4, 8, 16])
def test_devices_are_spread_over_the_period(count):
    spread = sorted(phases(*[{}] * count))
    gaps = [b - a for a, b in zip(spread, [*spread[1:], 1.0 + spread[0]], strict=True)]
    assert gaps == pytest.approx([1.0 / count] * count)
    assert all(0.0 <= phase < 1.0 for phase in spread)


def test_a_device_that_is_added_leaves_the_phases_of_the_others():
    assert phases(*[{}] * 5)[:4] == phases(*[{}] * 4)
    assert phases({}, {"phase": 0.5}, {}) == [phases({})[0], 0.5, phases({}, {})[1]]


@pytest.mark.parametrize("phase", [-0.1, 1.0, "half"])
def test_a_phase_outside_the_period_is_refused(phase):
    with pytest.raises(ConfigError, match=r"devices\.arm0\.phase: expected "):
        phases({"phase": phase})


def test_a_preset_is_overridden_by_what_is_given_beside_it(tmp_path):
    limits = limits_of(tmp_path, "preset = 'franka-panda', velocity = [2, 1, 2], jerk = 100")
    assert limits.acceleration == 25.0  # of the preset
    assert (limits.axis_velocity, limits.velocity, limits.jerk) == ((2.0, 1.0, 2.0), 3.0, 100.0)
    assert limits.linear_velocity == 1.0  # of the planner


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ("preset = 'franka'", "limits.preset: expected one of franka-fr3, franka-panda, ur5e"),
        ("velocity = [1, 2]", "limits.velocity: expected three finite numbers greater than 0"),
        ("jerk = [1, 0, 1]", "limits.jerk: expected three finite numbers greater than 0"),
        ("jerk = [1, 'a', 1]", "limits.jerk: expected three finite numbers greater than 0"),
        ("acceleration = 'a'", "limits.acceleration: expected a number, got the text 'a'"),
        ("linear_velocity = [1, 1, 1]", "limits.linear_velocity: expected a number, got [1, 1, 1]"),
    ],
)
def test_wrong_limits_are_refused_in_one_line_that_names_the_field(tmp_path, table, complaint):
    with pytest.raises(ConfigError) as caught:
        limits_of(tmp_path, table)
    assert f"devices.arm.{complaint}" in str(caught.value)
    assert "\n" not in str(caught.value)


OPERATION = """
[access.users]
alice = "operator"
[access.certificates]
pendant = "observer"
[tcp]
listen = "[::1]:7450"
certificate = "/c"
key = "/k"
ca = "/a"
revoked = ["00:ab:12"]
[devices.arm]
driver = "loopback"
"""


def test_roles_and_tcp_are_read(tmp_path):
    settings = config.load(write(tmp_path, OPERATION))
    assert settings.access.users == {"alice": Role.OPERATOR}
    assert settings.tcp.host_and_port == ("::1", 7450)
    assert settings.tcp.revoked == ["AB12"]
    assert json.loads(settings.model_dump_json())["access"]["users"] == {"alice": "operator"}


@pytest.mark.parametrize(
    ("was", "is_now", "complaint"),
    [
        ('"operator"', '"king"', "access.users.alice: expected one of observer, operator, admin"),
        ('"operator"', "3", "access.users.alice: expected one of observer, operator, admin"),
        ("[::1]:7450", "7450", "tcp.listen: expected HOST:PORT, got the text '7450'"),
        ("[::1]:7450", "a:b", "tcp.listen: expected HOST:PORT, got the text 'a:b'"),
        ("00:ab:12", "xyz", "tcp.revoked[0]: expected a serial number of at most 40 hexadecimal"),
        ('key = "/k"', "", "tcp.key: missing"),
    ],
)
def test_roles_and_addresses_that_are_none_are_refused(tmp_path, was, is_now, complaint):
    with pytest.raises(ConfigError, match=re.escape(complaint)):
        config.load(write(tmp_path, OPERATION.replace(was, is_now)))


@pytest.mark.parametrize("name", [key for key in config.Settings.model_fields if key != "devices"])
def test_every_table_tells_its_keys_to_who_misspells_one(tmp_path, name):
    path = write(tmp_path, f"[{name}]\nxyz = 1\n[devices.arm]\ndriver = 'x'")
    with pytest.raises(ConfigError, match=rf"{name}\.xyz: unknown key; known are \w+"):
        config.load(path)


def test_limits_by_axis_are_written_down_as_they_were_given():
    # Warnings are errors here: a user would see them at every start.
    limits = {"velocity": [2.0, 1.0, 2.5], "acceleration": 5.0}
    settings = config.parse(
        {"devices": {"arm": {"driver": "loopback", "limits": limits}}}, source="test"
    )
    told = json.loads(settings.model_dump_json())["devices"]["arm"]["limits"]
    assert {name: told[name] for name in limits} == limits
    assert settings.model_dump()["devices"]["arm"]["limits"]["velocity"] == (2.0, 1.0, 2.5)
