"""Check the shape of the packages: rooms, fronts, arrows, circles.  Run by ``make check``.

``structure.py FOLDER`` lists the places below a folder of tests that reach behind a front.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "orientd": "",
    **dict.fromkeys(
        ("orientd_alpaca", "orientd_batch", "orientd_bluesky", "orientd_diffusion_policy",
         "orientd_fleet", "orientd_mavlink", "orientd_replay", "orientd_rotctld",
         "orientd_serving"), "adapters"),
    **dict.fromkeys(("orientd_dynamixel", "orientd_loopback", "orientd_ur"), "drivers"),
    **dict.fromkeys(("emulated_base", "emulated_dynamixel", "emulated_ur"), "sim"),
}  # fmt: skip
GENERATED = ("_pb2",)

MOST_LINES = 650
MOST_MODULES = 20
LONGEST_CHAIN = 8

WITHOUT_CIRCLES = tuple(
    f"orientd.{name}" for name in ("curves", "daemon", "planner", "rotation", "stream", "servo")
)
"""Packages whose modules form no circle, type-checking and lazy imports included."""

NO_MODULE = ("orientd.kernels", "orientd")
"""The compiled library is no module that can be seen, and is taken for the whole package."""

TESTED = {"unit/batch": "orientd_batch", "unit/fleet": "orientd_fleet",
          "unit/mavlink": "orientd_mavlink", "unit/replay": "orientd_replay",
          "unit/rotctld": "orientd_rotctld",
          "unit/driver_ur": "orientd_ur", "unit/driver_dynamixel": "orientd_dynamixel",
          "unit/sim_ur": "emulated_ur",
          "unit/dynamixel_bus": "emulated_dynamixel", "unit/sim_base": "emulated_base"}  # fmt: skip
"""Folders of unit tests that are not called as the package of which they test the inside."""

BEHIND_FRONTS = {
    "": 1, "bench": 9, "chaos": 7, "data/standard": 1, "docs": 3, "drivers/dynamixel": 2,
    "drivers/ur": 24, "emulated": 6, "reference": 7, "storm": 8, "system": 22, "unit": 5,
    "unit/batch": 3, "unit/cli": 7, "unit/driver_dynamixel": 8, "unit/driver_ur": 3,
    "unit/kernels": 2, "unit/mechanism": 1, "unit/planner": 7, "unit/protocol": 1,
    "unit/recorder": 1, "unit/servo": 10, "world": 48,
}  # fmt: skip
"""How often the tests of other folders still reach behind a front.  A number may only shrink."""

Graph = Mapping[str, set[str]]


def is_generated(module: str) -> bool:
    return module.endswith(GENERATED)


@cache
def source(module: str) -> Path:
    """Return the file of a module, or of a package's front."""
    base = ROOT / PACKAGES[module.partition(".")[0]] / module.replace(".", "/")
    front = base / "__init__.py"  # a folder may be left of a package that is gone
    return front if front.exists() else base.with_suffix(".py")


@cache
def is_room(module: str) -> bool:
    return source(module).name == "__init__.py"


def room(module: str) -> str:
    return module if is_room(module) else module.rpartition(".")[0]


def above(module: str) -> Iterator[str]:
    """Yield the packages that a module is in, the outermost first."""
    parts = module.split(".")
    for end in range(1, len(parts)):
        yield ".".join(parts[:end])


def is_inside(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def imports(*, type_checking: bool = False) -> dict[str, set[str]]:
    """Return which module imports which when it runs, or also when types are checked."""
    graph = grimp.build_graph(
        *PACKAGES, exclude_type_checking_imports=not type_checking, cache_dir=None
    )
    excused = {NO_MODULE} if type_checking else _excused()
    found = {one: graph.find_modules_directly_imported_by(one) for one in graph.modules}
    return {one: {other for other in found[one] if (one, other) not in excused} for one in found}


def _excused() -> set[tuple[str, ...]]:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (layers, *_) = settings["tool"]["importlinter"]["contracts"]
    return {tuple(one.split(" -> ")) for one in layers["ignore_imports"]}


def large(graph: Graph) -> Iterator[str]:
    """Yield files and folders that have grown too large."""
    for module in graph:
        lines = len(source(module).read_text(encoding="utf-8").splitlines())
        if lines > MOST_LINES and not is_generated(module):
            yield f"{module} has {lines} lines, at most {MOST_LINES}"
    modules = Counter(room(module) for module in graph if not is_room(module))
    for name, count in modules.items():
        if count > MOST_MODULES:
            yield f"{name} has {count} modules, at most {MOST_MODULES}"


@cache
def open_modules(front: str) -> frozenset[str]:
    """Return the modules that a front lists in its docstring: others import from them."""
    text = ast.get_docstring(ast.parse(source(front).read_text(encoding="utf-8"))) or ""
    named = (f"{front}.{name}" for name in re.findall(r"``([\w.]+)``", text))
    return frozenset(one for one in named if source(one).exists())


def past_fronts(graph: Graph) -> Iterator[str]:
    """Yield imports from outside of modules that a room's front does not list."""
    for module, imported in graph.items():
        for other in imported:
            outside = (
                one for one in above(other) if one != "orientd" and not is_inside(module, one)
            )
            front = next(outside, None)
            is_free = (
                module == "orientd.__main__" or is_generated(other) or is_inside(other, module)
            )
            if (
                front is not None
                and front != other
                and not is_free
                and other not in open_modules(front)
            ):
                yield f"{module} imports {other}, which the docstring of {front} does not list"


def behind_fronts() -> Iterator[tuple[str, str]]:
    """Yield folder and place of each inside of a package that tests of another folder use.

    The inside is a module behind a front, or a member whose name begins with an underscore.
    """
    for path in sorted((ROOT / "tests").rglob("*.py")):
        name = path.relative_to(ROOT)
        parts = name.parts[1:]
        folder = "/".join(parts[: min(2, len(parts) - 1)])
        own = TESTED.get(folder, f"orientd.{parts[1]}" if parts[0] == "unit" else "")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                for module in sorted(filter(_is_behind, set(_modules(node)))):
                    if not (own and is_inside(module, own)):
                        yield folder, f"{name}:{node.lineno} imports {module}"
            elif isinstance(node, ast.Attribute) and _is_private(node) and not is_package(own):
                yield folder, f"{name}:{node.lineno} uses {ast.unparse(node)}"


def is_package(name: str) -> bool:
    return name.partition(".")[0] in PACKAGES and is_room(name)


def _is_private(node: ast.Attribute) -> bool:
    is_own = isinstance(node.value, ast.Name) and node.value.id in {"self", "cls"}
    is_public = node.attr.startswith("__") or node.attr in {"_replace", "_asdict", "_exit"}
    return node.attr.startswith("_") and not is_public and not is_own


def _modules(node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
        return
    for alias in node.names:
        name = f"{node.module}.{alias.name}"
        is_module = name.partition(".")[0] in PACKAGES and source(name).exists()
        yield name if is_module else str(node.module)


def _is_behind(module: str) -> bool:
    """Return whether a module is one of ours with a front before it."""
    if module.partition(".")[0] not in PACKAGES or is_generated(module):
        return False
    return any(one != "orientd" and module not in open_modules(one) for one in above(module))


def reaching_behind() -> Iterator[str]:
    """Yield folders of tests that reach behind fronts more often than they did."""
    counts = Counter(folder for folder, _ in behind_fronts())
    for folder, count in sorted(counts.items()):
        if count > (most := BEHIND_FRONTS.get(folder, 0)):
            yield (
                f"tests/{folder} reaches behind fronts {count} times, at most {most}: "
                f"see `python tests/structure.py tests/{folder}`"
            )


def circles(graph: Graph) -> Iterator[str]:
    """Yield modules that import each other by way of others, and rooms that do."""
    yield from (f"a circle of modules: {found}" for found in _circles(graph))
    for package in filter(is_room, graph):
        depth = package.count(".") + 2
        rooms: dict[str, set[str]] = defaultdict(set)
        for module, imported in graph.items():
            for other in imported:
                if module != package != other and is_inside(module, package):
                    here, there = (".".join(one.split(".")[:depth]) for one in (module, other))
                    if here != there and is_inside(other, package):
                        rooms[here].add(there)
        yield from (f"a circle of rooms: {found}" for found in _circles(rooms))


def hidden_circles(graph: Graph) -> Iterator[str]:
    """Yield circles through packages without any, in a graph of every import there is."""
    for found in _circles(graph):
        if any(is_inside(one, package) for one in found.split(", ") for package in WITHOUT_CIRCLES):
            yield f"a circle of modules, type-checking imports included: {found}"


def chains(graph: Graph) -> Iterator[str]:
    """Yield the longest chain of imports inside each room in which it is too long."""
    for package in filter(is_room, graph):
        inside = {
            module: {other for other in graph[module] if _is_in(other, package)}
            for module in graph
            if _is_in(module, package)
        }
        longest: dict[str, tuple[str, ...]] = {}

        def follow(
            module: str, inside: Graph, longest: dict[str, tuple[str, ...]]
        ) -> tuple[str, ...]:
            if module not in longest:
                longest[module] = (module,)  # should there be a circle
                tails = (follow(other, inside, longest) for other in inside[module])
                longest[module] = (module, *max(tails, key=len, default=()))
            return longest[module]

        chain = max((follow(one, inside, longest) for one in inside), key=len, default=())
        if len(chain) > LONGEST_CHAIN:
            names = " > ".join(module.rpartition(".")[2] for module in chain)
            yield f"{package}: a chain of {len(chain)} imports, at most {LONGEST_CHAIN}: {names}"


def shared_threads(graph: Graph) -> Iterator[str]:
    """Yield the places of the daemon that use asyncio's default executor, which everything shares.

    :mod:`orientd.daemon.workers` says which threads there are.
    """
    for module in (one for one in graph if is_inside(one, "orientd.daemon")):
        for node in ast.walk(ast.parse(source(module).read_text(encoding="utf-8"))):
            name = getattr(node, "attr", getattr(node, "id", ""))
            if name in ("to_thread", "run_in_executor", "getaddrinfo", "ThreadPoolExecutor"):
                yield f"{module}, line {node.lineno}: {name} in place of the daemon's own threads"


def _is_in(module: str, package: str) -> bool:
    return not is_room(module) and room(module) == package


def _circles(graph: Graph) -> Iterable[str]:
    """Return the strongly connected parts of a graph (Tarjan, 1972) as text."""
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[str] = []

    def visit(one: str) -> None:
        number[one] = lowest[one] = len(number)
        stack.append(one)
        for other in graph.get(one, ()):
            if other not in number:
                visit(other)
            if other in stack:
                lowest[one] = min(lowest[one], lowest[other])
        if lowest[one] == number[one]:
            part = stack[stack.index(one) :]
            del stack[stack.index(one) :]
            if len(part) > 1:
                found.append(", ".join(sorted(part)))

    for one in graph:
        if one not in number:
            visit(one)
    return found


def main() -> int:
    if len(sys.argv) > 1:
        sys.stdout.writelines(
            f"{place}\n" for _, place in behind_fronts() if place.startswith(sys.argv[1])
        )
        return 0
    sys.setrecursionlimit(10_000)
    graph = imports()
    checks = (large, past_fronts, circles, chains, shared_threads)
    problems = sorted(problem for check in checks for problem in check(graph))
    problems += [*hidden_circles(imports(type_checking=True)), *reaching_behind()]
    for problem in problems:
        sys.stdout.write(f"{problem}\n")
    if not problems:
        sys.stdout.write(f"{len(graph)} modules in their rooms\n")
    return 1 if problems else 0


if __name__ == "__main__":
    raise SystemExit(main())
