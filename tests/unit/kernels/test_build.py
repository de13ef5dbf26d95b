"""Build of the kernels: choice of the compiler, and the error if there is none."""

import sys

import pytest

from orientd import processor
from orientd.kernels import build


@pytest.fixture
def path(tmp_path, monkeypatch):
    """A PATH of its own, and no other compiler anywhere."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(build, "find_spec", lambda name: None)
    return tmp_path


def put(folder, name, script):
    (folder / name).write_text(f"#!{sys.executable}\n{script}\n")
    (folder / name).chmod(0o755)


def test_the_named_compiler_goes_before_all_others(path, monkeypatch):
    put(path, "cc", "")
    monkeypatch.setenv("CC", "gcc-14 -m64")
    assert build.compiler() == ["gcc-14", "-m64"]


@pytest.mark.parametrize("name", ["cc", "gcc", "clang"])
def test_a_compiler_of_the_machine_is_found(path, name):
    put(path, name, "")
    assert build.compiler() == [name]


def test_a_compiler_that_lacks_headers_or_the_widest_level_is_passed_over(path):
    put(path, "cc", "raise SystemExit('unknown value for -march')")
    put(path, "clang", "")
    assert build.compiler() == ["clang"]


def test_where_there_is_none_that_of_the_package_is_taken(path, monkeypatch):
    assert build.compiler() is None
    monkeypatch.setattr(build, "find_spec", lambda name: name == "ziglang")
    monkeypatch.setattr(build.platform, "machine", lambda: "aarch64")
    monkeypatch.setattr(build.platform, "libc_ver", lambda: ("glibc", "2.36"))
    command = [sys.executable, "-m", "ziglang", "cc", "-target", "aarch64-linux-gnu.2.28"]
    assert build.compiler() == [*command, "-nostdlib", "-lc"]
    monkeypatch.setattr(build.platform, "libc_ver", lambda: ("", ""))
    assert "aarch64-linux-musl" in build.compiler()


def test_a_package_is_asked_for_only_where_there_is_no_compiler(path):
    hook = build.get_build_hook()
    assert hook.dependencies(None) == [build.ZIG]
    put(path, "cc", "")
    assert hook.dependencies(None) == []


def test_a_python_without_its_lock_is_refused_in_a_line(path, monkeypatch):
    monkeypatch.setattr(build.sysconfig, "get_config_var", lambda name: 1)
    with pytest.raises(SystemExit, match="got a free-threaded one"):
        build.get_build_hook().dependencies(None)


def test_without_any_compiler_a_hand_build_says_what_to_do(path):
    with pytest.raises(SystemExit, match="no C compiler: install one, or run `pip install -e "):
        build.build(processor.builds())


def test_what_the_compiler_refuses_leaves_the_library_that_was_there(path, tmp_path, monkeypatch):
    put(path, "cc", "import sys; sys.exit('-shared' in sys.argv)")
    monkeypatch.setattr(processor, "KERNELS", tmp_path)
    library = tmp_path / "x86-64-v2" / processor.LIBRARY
    library.parent.mkdir()
    library.write_bytes(b"before")
    with pytest.raises(SystemExit, match="`cc` could not compile the kernels: x86-64-v2"):
        build.build(["x86-64-v2"])
    assert library.read_bytes() == b"before"
