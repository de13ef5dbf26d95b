"""Choice of the build of the kernels, by the flags of the processor."""

import subprocess
import sys

import pytest

from orientd import processor
from orientd.errors import KernelsError

V2, V3, V4 = processor.LEVELS
FLAGS = {
    V2: {*processor.LEVELS[V2]},
    V3: {*processor.LEVELS[V2], *processor.LEVELS[V3]},
    V4: {*processor.LEVELS[V2], *processor.LEVELS[V3], *processor.LEVELS[V4]},
}


@pytest.fixture
def machine(monkeypatch):
    """Stand in for a processor of x86-64 with the flags that are added."""
    flags = set()
    monkeypatch.setattr(processor.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(processor, "_flags", lambda: flags)
    monkeypatch.delenv(processor.FORCED, raising=False)
    return flags


@pytest.mark.parametrize("level", FLAGS)
def test_the_widest_level_that_the_processor_has_is_run(machine, level):
    machine |= FLAGS[level] | {"fpu", "sse"}
    assert processor.level() == level


@pytest.mark.parametrize("missing", sorted(FLAGS[V4]))
def test_a_level_asks_for_everything_that_narrower_ones_do(machine, missing):
    machine |= FLAGS[V4] - {missing}
    if missing in FLAGS[V2]:
        with pytest.raises(KernelsError, match=f"cannot run .* for {V2}: no {missing}$"):
            processor.level()
    else:
        assert processor.level() == (V2 if missing in FLAGS[V3] else V3)


def test_a_narrower_level_can_be_forced(machine, monkeypatch):
    machine |= FLAGS[V4]
    monkeypatch.setenv(processor.FORCED, V3)
    assert processor.level() == V3


def test_a_level_that_the_processor_lacks_is_refused_rather_than_run(machine, monkeypatch):
    machine |= FLAGS[V3]
    monkeypatch.setenv(processor.FORCED, V4)
    with pytest.raises(ImportError, match=f"cannot run .* for {V4}: no avx512bw, avx512cd"):
        processor.level()


def test_a_level_that_nobody_knows_is_refused_with_those_that_are_known(machine, monkeypatch):
    machine |= FLAGS[V4]
    monkeypatch.setenv(processor.FORCED, "avx2")
    with pytest.raises(ImportError) as caught:
        processor.level()
    assert str(caught.value) == (
        "ORIENTD_LEVEL: expected one of x86-64-v2, x86-64-v3, x86-64-v4, got 'avx2'"
    )


def test_any_other_architecture_has_one_build(monkeypatch):
    monkeypatch.setattr(processor.platform, "machine", lambda: "aarch64")
    monkeypatch.delenv(processor.FORCED, raising=False)
    assert processor.builds() == ["aarch64"]
    assert processor.level() == "aarch64"


def test_a_processor_that_says_nothing_runs_the_narrowest_level(machine, monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr(processor.platform, "machine", lambda: "x86_64")
    monkeypatch.delenv(processor.FORCED, raising=False)
    monkeypatch.setattr(processor, "Path", lambda name: processor.KERNELS / "nowhere")
    assert processor.level() == V2


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Stand in for an installed package: its folder of kernels, with a library and no sources."""
    monkeypatch.setattr(processor, "KERNELS", tmp_path)
    monkeypatch.setattr(processor, "SOURCES", tmp_path / "c")
    monkeypatch.setattr(processor, "BUILD", tmp_path / "build.py")
    library = tmp_path / processor.level() / processor.LIBRARY
    library.parent.mkdir()
    library.write_bytes(b"any")
    return library


def test_a_library_without_sources_beside_it_is_taken_as_it_is(installed):
    assert processor.library() == installed


def test_without_a_library_whoever_installed_is_told(installed):
    installed.unlink()
    with pytest.raises(KernelsError, match=r"no kernels for .*: install orientd again$"):
        processor.library()


@pytest.mark.parametrize("edited", ["a.c", "a.h", "../build.py", "new.c"])
def test_a_library_of_other_sources_is_refused(installed, edited):
    processor.SOURCES.mkdir()
    for name in ("a.c", "a.h", "../build.py"):
        (processor.SOURCES / name).write_text("before")
    installed.write_bytes(b"header " + processor.digest().encode() + b" code")
    assert processor.library() == installed
    (processor.SOURCES / edited).write_text("after")
    with pytest.raises(KernelsError, match=r"have changed: run `python .*build\.py`$"):
        processor.library()


def test_looking_loads_neither_kernels_nor_numpy():
    code = (
        "import sys; from orientd import processor; processor.library()\n"
        "print(*{'numpy', 'orientd.kernels'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "\n"
