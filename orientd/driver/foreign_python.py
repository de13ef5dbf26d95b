"""Run a module of ours with the interpreter of another environment, which has a vendor's packages.

Nothing of ours is installed there.  The daemon starts this file as a script with that interpreter.
A finder then serves the packages ``orientd`` and the driver's own from where they are here, and
everything else comes from that environment.  So a vendor's pins and ours never meet.
"""

from __future__ import annotations

import importlib.util
import json
import sys
from importlib.machinery import ModuleSpec

OLDEST = (3, 11)
"""The oldest Python that can run the servo process."""

_ANSWER_TIMEOUT = 30.0
_ASK = "import sys; print('Python', *sys.version_info[:3])"


class ServedPackages:
    """Find some packages in given places, before any other finder does.

    Args:
        places: file of each package's or module's source, by name.
    """

    def __init__(self, places: dict[str, str]) -> None:
        self._places = places

    def find_spec(self, fullname: str, *_: object) -> ModuleSpec | None:
        """Return where a package is; its modules are then found beside it."""
        place = self._places.get(fullname)
        return None if place is None else importlib.util.spec_from_file_location(fullname, place)


def python_command(python: str, module: str, driver: str, *arguments: str) -> list[str]:
    """Return the command that runs *module* with an interpreter.

    Args:
        python: the interpreter; empty for our own.
        module: of ``orientd``, to be run as a script.
        driver: ``module:Class``, whose package the module needs.
        arguments: for the module.
    """
    if not python:
        return [sys.executable, "-m", module, *arguments]
    names = ("orientd", driver.partition(":")[0].partition(".")[0])
    places = {name: _source(name) for name in names}
    # Isolated: neither PYTHONPATH nor a user's own packages lead back to ours.
    return [python, "-I", __file__, json.dumps(places), module, *arguments]


def python_version(python: str) -> str:
    """Return which Python an interpreter is, for example ``3.11.2``.

    Raises:
        ConfigError: there is none, it is no Python, or one too old for the servo process.
    """
    import subprocess  # no servo process has need of it

    from orientd.errors import ConfigError

    try:
        done = subprocess.run(
            [python, "-I", "-c", _ASK],
            capture_output=True, text=True, timeout=_ANSWER_TIMEOUT, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ConfigError(f"{python} did not answer within {_ANSWER_TIMEOUT:g} s") from None
    except OSError as error:
        raise ConfigError(f"cannot run {python}: {error.strerror}") from error
    word, *numbers = done.stdout.split() or [""]
    if done.returncode or word != "Python":
        raise ConfigError(f"{python} is no Python interpreter")
    found = ".".join(numbers)
    if tuple(map(int, numbers)) < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        raise ConfigError(f"{python} is Python {found}; the servo process needs {oldest} or newer")
    return found


def _source(name: str) -> str:
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        from orientd.errors import ConfigError

        raise ConfigError(f"the package {name!r} has no file that another Python could load")
    return spec.origin


def main() -> None:
    """Serve the packages of the first argument, then run the module of the second."""
    import runpy

    places, module, *arguments = sys.argv[1:]
    sys.meta_path.insert(0, ServedPackages(json.loads(places)))
    sys.argv[1:] = arguments
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
