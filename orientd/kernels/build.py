"""Build the kernels: by hand after an edit, and as a hook of the package's build.

Needs a C compiler: the one that ``CC`` names, ``cc``, or that of the package ``ziglang``, which the
build fetches where there is none.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from importlib import util
from pathlib import Path
from types import ModuleType

HOME = Path(__file__).parent

FLAGS = (
    "-std=gnu11", "-shared", "-fPIC", "-O3", "-Wall", "-Wextra",
    # Not -ffast-math: what is not a number keeps its meaning, and loading it must not change how
    # the whole process rounds.
    "-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-ffp-contract=fast",
    "-DPy_LIMITED_API=0x030b0000",
)  # fmt: skip
WIDE = {"x86-64-v4": ("-mprefer-vector-width=512",)}


def compiler() -> list[str]:
    """Return the command of a C compiler."""
    named = os.environ.get("CC", "").split()
    if named:
        return named
    if shutil.which("cc"):
        return ["cc"]
    return [sys.executable, "-m", "ziglang", "cc"]


def build(levels: list[str]) -> list[Path]:
    """Compile the kernels for some levels into folders of their names, and return the files."""
    with ThreadPoolExecutor() as pool:
        return list(pool.map(_build, levels))


def all_levels() -> list[str]:
    """Return the levels to build for this architecture."""
    machine = platform.machine().lower()
    return list(_levels().LEVELS) if machine in ("x86_64", "amd64") else [machine]


def _build(level: str) -> Path:
    target = HOME / level / "native.abi3.so"
    target.parent.mkdir(exist_ok=True)
    fresh = target.with_suffix(".new")
    march = (f"-march={level}",) if level.startswith("x86-64") else ()
    sources = sorted(map(str, (HOME / "c").glob("*.c")))
    subprocess.run(
        [
            *compiler(), *FLAGS, *march, *WIDE.get(level, ()),
            f"-I{sysconfig.get_path('include')}",
            f'-DORIENTD_LEVEL="{level}"', f'-DORIENTD_SOURCES="{_levels().digest()}"',
            *sources, "-o", str(fresh), "-lm",
        ],
        check=True,
    )  # fmt: skip
    fresh.replace(target)  # never a half-written library in the place of one in use
    return target


def _levels() -> ModuleType:
    """Load the module beside this one, without the package that needs what is to be built."""
    spec = util.spec_from_file_location("_orientd_levels", HOME / "levels.py")
    if spec is None or spec.loader is None:
        raise FileNotFoundError(HOME / "levels.py")
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    for library in build(all_levels()):
        print(f"built {library}")  # noqa: T201
