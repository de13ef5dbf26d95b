"""The package's names are loaded when they are asked for; none of them may hide a module."""

import importlib
import subprocess
import sys

import pytest

import orientd.planner


@pytest.mark.parametrize("name", orientd.planner.__all__)
def test_every_name_is_there(name):
    assert getattr(orientd.planner, name) is not None


def test_no_name_is_that_of_a_module():
    for name in orientd.planner.__all__:
        with pytest.raises(ModuleNotFoundError):
            importlib.import_module(f"orientd.planner.{name}")


def test_limits_need_nothing_that_plans():
    code = (
        "import sys\nfrom orientd.planner import DEFAULT_LIMITS\n"
        "print({'numpy', 'orientd.planner.planning'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("set()\n", "")
