"""The declarations of ``stable_abi.h`` agree with Python's own headers."""

import re
import subprocess
import sysconfig
from pathlib import Path

import pytest

from orientd.kernels.build import compiler
from orientd.processor import SOURCES

HEADERS = Path(sysconfig.get_path("include"))
OURS = SOURCES / "stable_abi.h"

STRUCTURES = {
    "PyObject": ["ob_refcnt", "ob_type"],
    "Py_buffer": [
        *("buf", "obj", "len", "itemsize", "readonly", "ndim", "format"),
        *("shape", "strides", "suboffsets", "internal"),
    ],
    "PyMethodDef": ["ml_name", "ml_meth", "ml_flags", "ml_doc"],
    "PyModuleDef_Slot": ["slot", "value"],
    "PyModuleDef": [
        *("m_base.ob_base", "m_base.m_init", "m_base.m_index", "m_base.m_copy"),
        *("m_name", "m_doc", "m_size", "m_methods", "m_slots", "m_traverse", "m_clear", "m_free"),
    ],
}
NUMBERS = ["PyBUF_WRITABLE", "PyBUF_FORMAT", "PyBUF_C_CONTIGUOUS", "METH_FASTCALL", "Py_mod_exec"]

pytestmark = pytest.mark.skipif(
    not (HEADERS / "Python.h").is_file() or compiler() is None,
    reason="needs a compiler and Python's headers",
)


def compile_c(source, folder, *options):
    file = folder / "source.c"
    file.write_text(source)
    command = [*compiler(), "-Wall", "-Wextra", "-Werror", "-DPy_LIMITED_API=0x030b0000"]
    command += [f"-I{HEADERS}", *options, str(file), "-o", str(folder / "out")]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def values(header, folder):
    """Return sizes, offsets and numbers as a compiler sees them behind *header*."""
    asked = [f"sizeof({name})" for name in STRUCTURES]
    asked += [f"offsetof({name}, {one})" for name, ones in STRUCTURES.items() for one in ones]
    asked += NUMBERS
    prints = "".join(f'    printf("%ld\\n", (long)({one}));\n' for one in asked)
    source = f"#include <stddef.h>\n#include <stdio.h>\nint main(void) {{\n{prints}}}\n"
    done = compile_c(source, folder, "-include", header)
    assert done.returncode == 0, done.stderr
    lines = subprocess.run([folder / "out"], capture_output=True, text=True, check=True).stdout
    return dict(zip(asked, map(int, lines.split()), strict=True))


def test_structures_and_numbers_are_those_of_python(tmp_path):
    assert values(str(OURS), tmp_path) == values("Python.h", tmp_path)


def test_functions_are_declared_as_python_declares_them(tmp_path):
    """A compiler refuses a second declaration that differs from the first."""
    both = f'#include <Python.h>\n#include "{OURS}"\n'
    done = compile_c(both, tmp_path, "-c")
    assert done.returncode == 0, done.stderr
    declared = re.findall(r"^extern \w+ \**(Py\w+)\(", OURS.read_text(), re.MULTILINE)
    wrong = both + "extern char Py_BuildValue(int);\n"
    assert "Py_BuildValue" in declared
    assert compile_c(wrong, tmp_path, "-c").returncode != 0


def test_the_kernels_are_the_same_behind_pythons_own_headers(tmp_path):
    """The binding compiles with them too, without a warning."""
    options = ["-include", "Python.h", "-std=gnu11", "-fsyntax-only", f"-I{SOURCES}"]
    for source in SOURCES.glob("*.c"):
        if "binding.h" in source.read_text():
            names = ['-DORIENTD_LEVEL="any"', '-DORIENTD_SOURCES="any"']
            done = compile_c(f'#include "{source}"\n', tmp_path, *options, *names)
            assert done.returncode == 0, done.stderr
