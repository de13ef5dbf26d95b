"""Build the kernels with the address and undefined-behaviour sanitizers, and try them hard.

``make sanitize`` copies the sources to build/sanitized, builds them there, and runs the fuzzer and
the tests of curves, planner and kernels against that build.  Without sanitizers in the compiler it
says so and does nothing.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
COPY = ROOT / "build" / "sanitized"
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-g")
FUZZ = "tests/unit/kernels/fuzz.py"
TESTS = (
    *("tests/unit/kernels", "tests/unit/rotation", "tests/unit/curves/test_trajectory.py"),
    *("tests/unit/curves/test_golden.py", "tests/unit/curves/test_laws.py"),
    *("tests/unit/planner/test_plan.py", "tests/unit/planner/test_retarget.py"),
    *("tests/unit/planner/test_certified.py", "tests/unit/planner/test_quickest.py"),
)
CASES = os.environ.get("ORIENTD_CASES", "2000")
SLOW = 600
"""Longest time of a test with the sanitizers, s."""


def main() -> None:
    """Build and run; exit with the first status that is not 0."""
    compiler = os.environ.get("CC", "gcc")
    runtime = runtime_of(compiler)
    if runtime is None:
        print(f"{compiler} has no address sanitizer: nothing was tried")
        return
    shutil.rmtree(COPY, ignore_errors=True)
    for folder in ("orientd", "adapters", "drivers", "sim", "tests", "config"):
        ignored = shutil.ignore_patterns("*.so", "__pycache__")
        shutil.copytree(ROOT / folder, COPY / folder, ignore=ignored)
    shutil.copy(ROOT / "pyproject.toml", COPY)
    level = subprocess.run(
        [sys.executable, "-c", "from orientd.processor import level; print(level())"],
        cwd=COPY, check=True, capture_output=True, text=True,
    ).stdout.strip()  # fmt: skip
    build = {**os.environ, "CC": " ".join([compiler, *SANITIZERS])}
    run([sys.executable, "orientd/kernels/build.py", level], build)
    checked = {
        **os.environ,
        "LD_PRELOAD": runtime,
        # Python keeps what it has until it ends, which is no leak of ours.
        "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1",
        "PYTHONPATH": str(COPY),
        "ORIENTD_LEVEL": level,
        "ORIENTD_FUZZ_LOG": str(COPY / "fuzz.log"),
    }
    run([sys.executable, FUZZ, CASES, "1"], checked)
    options = ("-q", "-x", "-p", "no:cacheprovider", f"--timeout={SLOW}")
    run([sys.executable, "-m", "pytest", *options, *TESTS], checked)


def runtime_of(compiler: str) -> str | None:
    """Return the libraries that have to be loaded first; none if there is no address sanitizer.

    With that of C++ the sanitizer knows the exceptions of other libraries.
    """
    libraries = []
    try:
        for name in ("libasan.so", "libstdc++.so.6"):
            found = subprocess.run(
                [*compiler.split(), f"-print-file-name={name}"],
                check=True, capture_output=True, text=True,
            ).stdout.strip()  # fmt: skip
            libraries += [found] if Path(found).is_file() else []
    except (OSError, subprocess.CalledProcessError):
        return None
    return " ".join(libraries) if libraries and "libasan" in libraries[0] else None


def run(command: list[str], environment: dict[str, str]) -> None:
    """Run a command in the copy; exit with its status unless that is 0."""
    print("+", " ".join(command[1:]), flush=True)
    status = subprocess.run(command, cwd=COPY, env=environment, check=False).returncode
    if status:
        log = COPY / "fuzz.log"
        if FUZZ in command and log.is_file():
            print(f"at the call {log.read_text().strip()}")
        raise SystemExit(status)


if __name__ == "__main__":
    main()
