"""Run an orientd module with the interpreter of another environment, which has a vendor's packages.

Nothing of orientd is installed in that environment.  The daemon starts this file as a script with
that interpreter.  A finder then serves the packages ``orientd`` and the driver's own from this
installation.  Everything else comes from the other environment, so the pinned versions of a vendor
never conflict with those of orientd.
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
        places: source file of each package or module, by name.
    """

    def __init__(self, places: dict[str, str]) -> None:
        self._places = places

    def find_spec(self, fullname: str, *_: object) -> ModuleSpec | None:
        """Return the location of a package; its modules are found next to it."""
        place = self._places.get(fullname)
        return None if place is None else importlib.util.spec_from_file_location(fullname, place)


def python_command(python: str, module: str, driver: str, *arguments: str) -> list[str]:
    """Return the command that runs *module* with an interpreter.

    Args:
        python: the interpreter; empty for the running one.
        module: the module of ``orientd`` to run as a script.
        driver: ``module:Class``; the module needs its package.
        arguments: arguments of the module.
    """
    if not python:
        return [sys.executable, "-m", module, *arguments]
    names = ("orientd", driver.partition(":")[0].partition(".")[0])
    places = {name: _source(name) for name in names}
    # Isolated mode: PYTHONPATH and a user's packages must not shadow those of the environment.
    return [python, "-I", __file__, json.dumps(places), module, *arguments]


def python_version(python: str) -> str:
    """Return the version of an interpreter, for example ``3.11.2``.

    Raises:
        ConfigError: the interpreter does not exist, is not Python, or is too old for the servo
        process.
    """
    import subprocess  # no servo process needs it

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
        raise ConfigError(f"{python} is not a Python interpreter")
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
