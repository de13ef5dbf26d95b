"""`orientd service install`: a systemd unit for this machine, or for this user."""

from __future__ import annotations

import os
import pwd
import subprocess
import sys
from pathlib import Path
from typing import Annotated

from orientd.cli.output import Output
from orientd.cli.parameters import Group, Option, part_of
from orientd.errors import ConfigError
from orientd.files import written

service = Group(name="service", help="Run the daemon as a systemd service.")

NAME = "orientd.service"

UNITS = Path(__file__).parents[1] / "units"
"""The units, with braces around machine-dependent parts."""

NOBODY = 65534
"""Stands for a user who does not exist yet and owns nothing."""


def unit(*, python: str, config: Path, user: str | None) -> str:
    """Return the unit, of the system for *user*, or of the user if that is ``None``.

    Args:
        python: the interpreter of orientd's installation.
        config: the configuration.
        user: the user of the daemon.
    """
    template = UNITS / ("user.service" if user is None else "system.service")
    return template.read_text(encoding="utf-8").format(
        python=_quoted(python), config=_quoted(str(config)), user=user
    )


@part_of(service)
def install(
    out: Output,
    config: Annotated[Path, Option("--config", "-c", help="The configuration of the daemon.")],
    for_user: Annotated[
        bool, Option("--user", help="Install a user unit instead of a system unit.")
    ] = False,
    run_as: Annotated[
        str, Option("--as", metavar="USER", help="User that runs the daemon of a system unit.")
    ] = "orientd",
    only_print: Annotated[bool, Option("--print", help="Only print the unit.")] = False,
) -> None:
    """Write a hardened unit, and print how to start it.  Starts nothing itself."""
    from orientd import config as configuration

    configuration.load(config)
    text = unit(python=sys.executable, config=config.absolute(), user=None if for_user else run_as)
    if only_print:
        out.answer({"unit": text}, text.rstrip("\n"))
        return
    if not for_user and os.geteuid() == 0:
        check_runs(sys.executable, config.absolute(), run_as)
    path = _directory(for_user=for_user) / NAME
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written(path) as part:
            part.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error
    steps = _steps(for_user=for_user, run_as=run_as)
    lines = [f"wrote {path}; now:", *(f"  {step}" for step in steps)]
    out.answer({"path": path, "steps": steps}, *lines)


def check_runs(python: str, config: Path, user: str) -> None:
    """Check that *user*, or any user if it does not exist yet, can run orientd with *config*.

    Args:
        python: the interpreter of orientd's installation.
        config: the configuration.
        user: the user of the daemon.

    Raises:
        ConfigError: they cannot.
    """
    try:
        known = pwd.getpwnam(user)
        uid, gid, groups = known.pw_uid, known.pw_gid, os.getgrouplist(user, known.pw_gid)
    except KeyError:
        uid, gid, groups = NOBODY, NOBODY, []
    program = f"import orientd.config; open({str(config)!r}).close()"
    try:
        done = subprocess.run(
            [python, "-c", program],
            user=uid, group=gid, extra_groups=groups, cwd="/",
            env={"PATH": os.defpath, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True, text=True, timeout=60.0, check=False,
        )  # fmt: skip
        problem = done.stderr.strip().rpartition("\n")[2] if done.returncode else ""
    except (OSError, subprocess.TimeoutExpired) as error:
        problem = str(error)
    if problem:
        raise ConfigError(
            f"{user} cannot run {python} with {config}: {problem}; install orientd where every "
            "user may read it, for example into a virtual environment below /opt"
        )


def _directory(*, for_user: bool) -> Path:
    if not for_user:
        return Path("/etc/systemd/system")
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(home) / "systemd" / "user"


def _steps(*, for_user: bool, run_as: str) -> list[str]:
    if for_user:
        return [
            "systemctl --user daemon-reload",
            "systemctl --user enable --now orientd",
            "loginctl enable-linger   # to run without a login",
            "orientd doctor           # real time needs rtprio and memlock in limits.conf",
        ]
    steps = ["systemctl daemon-reload", "systemctl enable --now orientd"]
    try:
        pwd.getpwnam(run_as)
    except KeyError:
        steps.insert(0, f"useradd --system --no-create-home --groups dialout {run_as}")
    return steps


def _quoted(text: str) -> str:
    """Return *text* as one word of a unit's command line (systemd.service(5), systemd.unit(5))."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{escaped}"'
