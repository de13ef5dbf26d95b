"""The ledger of mutants fits the sources, and a run tells those that survive."""

import textwrap

import mutants
import pytest

LEDGER = """
[noticed]
file = "orientd/sum.py"
old = "a + b"
new = "a - b"
breaks = "Sums are wrong."
test = "tests/test_sum.py::test_a_sum tests/test_sum.py::test_a_child"

[unnoticed]
file = "orientd/sum.py"
old = "0.5"
new = "1.5"
breaks = "Halves are wrong."
test = "tests/test_sum.py::test_a_sum"

[red]
file = "orientd/sum.py"
old = "return 0.5"
new = "return 2.5"
breaks = "Halves are wrong."
test = "tests/test_sum.py::test_a_red_one"

[elsewhere]
file = "orientd/__init__.py"
old = "Sums."
new = "Products."
breaks = "The package is described wrongly."
test = "tests/test_sum.py::test_a_sum"
"""


@pytest.fixture
def root(tmp_path):
    """The sources of a small package, with a test of a child process and one that always fails."""
    files = {
        "pyproject.toml": '[tool.pytest.ini_options]\nfilterwarnings = ["error"]\n',
        "orientd/__init__.py": '"""Sums."""',
        "orientd/sum.py": """
            def total(a, b):
                return a + b

            def half():
                return 0.5
        """,
        "tests/test_sum.py": """
            import subprocess
            import sys

            from orientd.sum import total

            CHILD = "import orientd.sum; assert orientd.sum.total(1, 2) == 3"

            def test_a_sum():
                assert total(1, 2) == 3

            def test_a_child():
                assert subprocess.call([sys.executable, "-c", CHILD]) == 0

            def test_a_red_one():
                assert False
        """,
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(textwrap.dedent(text))
    return tmp_path


def test_every_mutant_can_be_made_and_names_its_tests():
    assert list(mutants.problems(mutants.read(mutants.FILE.read_text(encoding="utf-8")))) == []


def test_survivors_of_a_file_and_tests_that_fail_anyway_are_told(root, capsys):
    ledger = root / "mutants.toml"
    ledger.write_text(LEDGER)
    before = (root / "orientd/sum.py").read_text()
    assert mutants.main(["-n", "1", "orientd/sum.py"], root, ledger) == 1
    told = capsys.readouterr().out.splitlines()
    ended = {line.split()[0]: line.split(" s  ")[1] for line in told[:-1]}
    assert ended == {
        "noticed": "killed",
        "unnoticed": "SURVIVES",
        "red": "FAILS without it: tests/test_sum.py::test_a_red_one",
    }
    assert told[-1] == "3 mutants, 1 of them killed"
    assert (root / "orientd/sum.py").read_text() == before
