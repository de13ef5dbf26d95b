"""Build the kernels: by hand after an edit, and as a hook of the package's build.

By hand it needs nothing but Python and a C compiler::

    python orientd/kernels/build.py [LEVEL ...]

The compiler is the one that ``CC`` names, one of the machine, or that of the package
``ziglang``.  The package's build fetches ``ziglang`` if it finds no other compiler.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[2]

FLAGS = (
    "-std=gnu11", "-shared", "-fPIC", "-O3", "-Wall", "-Wextra", "-s",
    # Calls between the files of the kernels need no procedure linkage table.
    "-fvisibility=hidden",
    # Not -ffast-math: NaN keeps its meaning, and loading the library must not change the rounding
    # of the whole process.
    "-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-ffp-contract=fast",
)  # fmt: skip
WIDE = {"x86-64-v4": ("-mprefer-vector-width=512",)}

ZIG = "ziglang>=0.14,<0.18"
GLIBC = "2.28"
"""The oldest C library that a build with Zig supports, the same as for NumPy and SciPy."""

PROBE = "#include <math.h>\n#include <stdlib.h>\n#include <string.h>\n"


def build(levels: list[str]) -> list[Path]:
    """Compile the kernels for some levels into folders of their names, and return the files.

    Raises:
        SystemExit: there is no compiler, or it refuses.
    """
    command = compiler()
    if command is None:
        raise SystemExit(f"orientd: no C compiler: install one, or run `pip install -e {ROOT}`")
    processor = _processor()
    with ThreadPoolExecutor() as pool:
        return list(pool.map(lambda level: _build(command, level, processor), levels))


def compiler() -> list[str] | None:
    """Return the command of a usable C compiler, if there is one."""
    named = os.environ.get("CC", "").split()
    if named:
        return named
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name) and _is_usable(name):
            return [name]
    if find_spec("ziglang") is None:
        return None
    libc = f"gnu.{GLIBC}" if platform.libc_ver()[0] == "glibc" else "musl"
    target = f"{platform.machine().lower()}-linux-{libc}"
    # No kernel needs Zig's run-time library, and every level would build it again.
    return [sys.executable, "-m", "ziglang", "cc", "-target", target, "-nostdlib", "-lc"]


def _is_usable(name: str) -> bool:
    """Return whether a compiler has the C library's headers and knows the widest level."""
    command = [name, *_march([name], _processor().builds()[-1]), "-fsyntax-only", "-xc", "-"]
    done = subprocess.run(command, input=PROBE, text=True, capture_output=True, check=False)
    return done.returncode == 0


def _march(command: list[str], level: str) -> tuple[str, ...]:
    if not level.startswith("x86-64"):
        return ()
    is_zig = any(Path(word).name.startswith("zig") for word in command)
    return (f"-march={level.replace('-', '_') if is_zig else level}",)


def _build(command: list[str], level: str, processor: ModuleType) -> Path:
    target: Path = processor.KERNELS / level / processor.LIBRARY
    target.parent.mkdir(exist_ok=True)
    fresh = target.with_suffix(".new")
    done = subprocess.run(
        [
            *command, *FLAGS, *_march(command, level), *WIDE.get(level, ()),
            f'-DORIENTD_LEVEL="{level}"', f'-DORIENTD_SOURCES="{processor.digest()}"',
            *sorted(map(str, processor.SOURCES.glob("*.c"))), "-o", str(fresh), "-lm",
        ],
        check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise SystemExit(f"orientd: `{' '.join(command)}` could not compile the kernels: {level}")
    fresh.replace(target)  # never replaces a library in use with a half-written one
    return target


def _processor() -> ModuleType:
    """Import ``orientd.processor`` alone: the rest of the package needs the built kernels."""
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))
    from orientd import processor

    return processor


def get_build_hook() -> type:
    """Return the hook that hatchling calls while it builds a wheel, also an editable one."""
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface

    class KernelsHook(BuildHookInterface[Any]):
        def dependencies(self) -> list[str]:
            if sysconfig.get_config_var("Py_GIL_DISABLED"):
                raise SystemExit(
                    "orientd: expected a Python with its global lock, got a free-threaded one, "
                    "which has no stable ABI"
                )
            return [ZIG] if compiler() is None else []

        def initialize(self, version: str, build_data: dict[str, Any]) -> None:
            libraries = build(_processor().builds())
            platform_tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["pure_python"] = False
            build_data["tag"] = f"cp311-abi3-{platform_tag}"
            if version != "editable":  # an editable install uses the files next to the sources
                for library in libraries:
                    place = library.relative_to(ROOT).as_posix()
                    build_data["force_include"][str(library)] = place

    return KernelsHook


if __name__ == "__main__":
    for library in build(sys.argv[1:] or _processor().builds()):
        print(f"built {library}")  # noqa: T201
