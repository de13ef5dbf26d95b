"""Arguments and attributes in docstrings exist by that name."""

import ast
import re
from pathlib import Path

import pytest

from orientd.curves.contract import SHARED

ROOT = Path(__file__).parents[2]
FILES = sorted(
    path
    for folder in ("orientd", "adapters", "drivers", "sim")
    for path in (ROOT / folder).rglob("*.py")
    if not path.stem.endswith("_pb2")
)
SECTION = re.compile(r"^(?:Args|Attributes):\n((?:    .*\n?|\n)*)", re.MULTILINE)
ENTRY = re.compile(r"^    ([^\s:][^:\n]*):(?:\s|$)", re.MULTILINE)


def parameters(function):
    given = function.args
    several = [one for one in (given.vararg, given.kwarg) if one is not None]
    return {one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs, *several)}


def attributes(of):
    """Return the names that a class gives its own, and those that it writes to."""
    methods = [one for one in of.body if isinstance(one, ast.FunctionDef)]
    written = {
        one.attr if isinstance(one, ast.Attribute) else one.id
        for one in ast.walk(of)
        if isinstance(one, ast.Attribute | ast.Name) and isinstance(one.ctx, ast.Store)
    }
    begins = [one for one in methods if one.name in ("__init__", "_make", "_solve")]
    if any(one.name == "_solve" for one in methods):
        written |= SHARED.keys()
    return written | {one.name for one in methods} | set().union(*map(parameters, begins))


def listed(docstring):
    """Yield the names in the sections of a docstring."""
    for section in SECTION.findall(docstring):
        for names in ENTRY.findall(section):
            yield from (name.strip("`* ") for name in re.split(r",\s*|\s+and\s+", names))


@pytest.mark.parametrize("folder", ["orientd", "adapters", "drivers", "sim"])
def test_what_a_docstring_lists_is_there(folder):
    wrong, count = [], 0
    for path in FILES:
        if path.relative_to(ROOT).parts[0] != folder:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                known = attributes(node)
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                known = parameters(node)
            else:
                continue
            names = list(listed(ast.get_docstring(node) or ""))
            count += len(names)
            place = f"{path.relative_to(ROOT)}, {node.name}"
            wrong += [f"{place}: {name}" for name in names if name not in known]
    assert wrong == []
    assert count > 50
