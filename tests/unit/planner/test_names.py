"""Packages load the names that they offer when asked for one; none of them may hide a module."""

import importlib
import subprocess
import sys

import pytest

OFFERED = [
    (package, name)
    for package in ("orientd.client", "orientd.curves", "orientd.planner", "orientd_fleet")
    for name in importlib.import_module(package).__all__
]


@pytest.mark.parametrize(("package", "name"), OFFERED)
def test_every_name_is_there(package, name):
    assert getattr(importlib.import_module(package), name) is not None


@pytest.mark.parametrize(("package", "name"), OFFERED)
def test_no_name_is_that_of_a_module(package, name):
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module(f"{package}.{name}")


def test_an_unknown_name_is_no_attribute():
    with pytest.raises(ImportError, match="cannot import name 'unheard'"):
        exec("from orientd.planner import unheard")


@pytest.mark.parametrize(
    "imports",
    [
        "from orientd.model.limits import DEFAULT_LIMITS",
        "from orientd.planner import DEFAULT_LIMITS",
        "from orientd.planner import facts",
    ],
)
def test_limits_and_facts_need_nothing_that_plans(imports):
    code = (
        f"import sys\n{imports}\nprint({{'numpy', 'orientd.planner.planning'}} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("set()\n", "")
