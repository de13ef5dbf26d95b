"""Programs import from `orientd`, which loads a name when asked for it; packages load little."""

import ast
import importlib
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import orientd


@pytest.mark.parametrize("name", orientd.__all__)
def test_every_name_is_there(name):
    assert getattr(orientd, name) is not None


@pytest.mark.parametrize("name", orientd.__all__)
def test_no_name_hides_a_module(name):
    module = f"orientd.{name}"
    assert find_spec(module) is None or getattr(orientd, name) is importlib.import_module(module)


def test_a_type_checker_finds_each_name_where_a_program_does():
    tree = ast.parse(Path(orientd.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.asname or alias.name: getattr(importlib.import_module(node.module), alias.name)
        for node in block.body
        for alias in node.names
        if node.module != "typing"
    }
    names = set(orientd.__all__) - {"__version__"}
    assert seen == {name: getattr(orientd, name) for name in names}


def test_an_unknown_name_is_no_attribute():
    with pytest.raises(ImportError, match="cannot import name 'unheard'"):
        exec("from orientd import unheard")


@pytest.mark.parametrize(
    "imports",
    [
        "from orientd import DEFAULT_LIMITS",
        "from orientd.model.limits import DEFAULT_LIMITS",
        "from orientd.planner import facts",
    ],
)
def test_limits_and_facts_need_nothing_that_plans(imports):
    code = (
        f"import sys\n{imports}\nprint({{'numpy', 'orientd.planner.planning'}} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("set()\n", "")


@pytest.mark.parametrize(
    "package",
    ["orientd", "orientd.client", "orientd.planner", "orientd_fleet", "orientd_replay"],
)
def test_importing_a_package_loads_nothing_but_the_package(package):
    code = (
        f"import sys\nbefore = set(sys.modules)\nimport {package}\n"
        "print(*sorted(set(sys.modules) - before - {'__future__'}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == sorted({package.partition(".")[0], package})
