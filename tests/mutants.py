"""Break the sources on purpose, and see that a test fails; mutants.toml lists how.

::

    python tests/mutants.py [-n AT_ONCE] [NAME or FILE ...]

makes each change in a copy of the sources, which is otherwise unchanged, and runs the tests that
the entry names.  The exit status is 1 if all of them pass, or if one fails without the change.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from orientd import processor

ROOT = Path(__file__).parents[1]
FILE = Path(__file__).with_name("mutants.toml")

PACKAGES = ("", "adapters", "drivers", "sim")
"""Folders of packages; in PYTHONPATH they come before those that are installed."""

LONGEST = 1200.0
"""Time after which a run of tests that hangs counts as failed, s."""

_LEFT_OUT = shutil.ignore_patterns(".git", ".*_cache", ".venv", ".hypothesis", "build", "dist")
_FAILED = 1


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """A change of one file that breaks something, and the tests that notice it."""

    name: str
    file: str
    old: str
    new: str
    breaks: str
    test: tuple[str, ...]


def read(text: str) -> list[Mutant]:
    """Return the mutants of a ledger."""
    tables = tomllib.loads(text).items()
    return [
        Mutant(name=name, **{**keys, "test": (*keys["test"].split(),)}) for name, keys in tables
    ]


def problems(mutants: list[Mutant], root: Path = ROOT) -> Iterator[str]:
    """Yield what is wrong with mutants: no single place, no test, no effect, or two alike."""
    seen: dict[tuple[str, str, str], str] = {}
    for mutant in mutants:
        name, places = mutant.name, _content(root / mutant.file).count(mutant.old)
        if places != 1:
            yield f"{name}: {mutant.file} has `old` {places} times, expected once"
        if mutant.old == mutant.new:
            yield f"{name}: `new` is `old`"
        other = seen.setdefault((mutant.file, mutant.old, mutant.new), name)
        if other != name:
            yield f"{name}: the same change as {other}"
        if not mutant.test or not mutant.breaks:
            yield f"{name}: expected a test and what breaks"
        for test in mutant.test:
            if _place(test, root)[1] < 0:
                yield f"{name}: there is no test {test}"


def _place(test: str, root: Path) -> tuple[str, int]:
    """Return the file of a test and its place there, -1 if there is none."""
    file, _, function = test.partition("::")
    return file, _content(root / file).find(f"def {function.partition('[')[0]}(")


def _content(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


class Copy:
    """A copy of the sources, which one mutant at a time changes."""

    def __init__(self, root: Path, folder: Path) -> None:
        """Copy the sources with the compiled kernels."""
        self._root = Path(shutil.copytree(root, folder, ignore=_LEFT_OUT, symlinks=True))
        path = os.pathsep.join(str(self._root / name) for name in PACKAGES)
        self._environment = {**os.environ, "PYTHONPATH": path}
        for name in ("TEST_RUN_OF_ORIENTD", "TESTS_THAT_PASSED"):
            self._environment.pop(name, None)
        self._seconds = 0

    def run(self, tests: list[str], *options: str) -> tuple[int, str]:
        """Run tests of the copy; return the exit status of pytest, and its summary."""
        always = ("-q", "-p", "no:cacheprovider", "-o", "timeout=60", "--tb=no", "-rfE")
        return self._python("-m", "pytest", *always, *options, *tests)

    @contextlib.contextmanager
    def changed(self, mutant: Mutant) -> Iterator[None]:
        """Change a file, and compile the kernels if it is one of theirs; undo both at the end."""
        path = self._root / mutant.file
        library = self._root / processor.library().relative_to(ROOT)
        is_kernel = path.parent == self._root / processor.SOURCES.relative_to(ROOT)
        kept = {one: one.with_suffix(".kept") for one in [path, library][: 1 + is_kernel]}
        for one, aside in kept.items():
            shutil.copy2(one, aside)
        try:
            path.write_text(_content(path).replace(mutant.old, mutant.new), encoding="utf-8")
            # By its time, a whole number of seconds, Python knows that a compiled module is old.
            self._seconds += 1
            os.utime(path, (self._seconds, self._seconds))
            if is_kernel and self._python("orientd/kernels/build.py", processor.level())[0] != 0:
                raise SystemExit(f"{mutant.name}: {mutant.file} does not compile")
            yield
        finally:
            for one, aside in kept.items():
                aside.replace(one)

    def _python(self, *words: str) -> tuple[int, str]:
        with tempfile.TemporaryFile("w+", encoding="utf-8") as output:
            process = subprocess.Popen(
                [sys.executable, *words], cwd=self._root, env=self._environment, process_group=0,
                stdin=subprocess.DEVNULL, stdout=output, stderr=output,
            )  # fmt: skip
            try:
                status = process.wait(LONGEST)
            except subprocess.TimeoutExpired:
                status = _FAILED
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            output.seek(0)
            return status, output.read()


def red_tests(tests: list[str], copy: Copy, at_once: int) -> frozenset[str]:
    """Return the tests that do not pass in an unchanged copy.

    Raises:
        SystemExit: they cannot be run.
    """
    status, summary = copy.run(tests, "-n", str(at_once), "--dist", "loadfile")
    lines = [line for line in summary.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    red = frozenset(test for test in tests if any(test in line for line in lines))
    if status != 0 and not (status == _FAILED and red):
        raise SystemExit(f"the tests cannot be run:\n{summary[-2000:]}")
    return red


def outcome(mutant: Mutant, copy: Copy, red: frozenset[str]) -> str:
    """Return how the tests of a mutant end: "killed" if one of them fails because of it."""
    if failing := red.intersection(mutant.test):
        return f"FAILS without it: {', '.join(sorted(failing))}"
    with copy.changed(mutant):
        status, _ = copy.run([*mutant.test], "-x")
    return {0: "SURVIVES", _FAILED: "killed"}.get(status, f"DOES NOT RUN: status {status}")


def main(words: list[str], root: Path = ROOT, file: Path = FILE) -> int:
    """Run the mutants of some names or files, by default all; return the exit status."""
    parser = argparse.ArgumentParser(description="Break the sources, and see that a test fails.")
    parser.add_argument("-n", type=int, default=os.cpu_count(), help="mutants at once")
    parser.add_argument("only", nargs="*", help="names of mutants, files or folders")
    given = parser.parse_args(words)
    only = tuple(given.only) or ("",)
    mutants = [one for one in read(_content(file)) if one.name in only or one.file.startswith(only)]
    wrong = list(problems(mutants, root))
    if not mutants:
        wrong = [f"expected names or files of {file.name}, got {' '.join(only)}"]
    if wrong:
        print("\n".join(wrong), file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        Path(folder).chmod(0o755)  # for tests that act as another user
        copies: SimpleQueue[Copy] = SimpleQueue()
        for number in range(given.n):
            copies.put(copy := Copy(root, Path(folder) / str(number)))
        tests = {test for one in mutants for test in one.test}
        # As in their files: tests that share a daemon may end what others need.
        in_order = sorted(tests, key=lambda test: _place(test, root))
        red = red_tests(in_order, copy, given.n)

        def run(mutant: Mutant) -> bool:
            free = copies.get()
            begin = time.monotonic()
            ended = outcome(mutant, free, red)
            print(f"{mutant.name:30}{time.monotonic() - begin:6.1f} s  {ended}", flush=True)
            copies.put(free)
            return ended == "killed"

        with ThreadPoolExecutor(given.n) as pool:
            killed = list(pool.map(run, mutants))
    print(f"{len(killed)} mutants, {sum(killed)} of them killed")
    return 0 if all(killed) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
