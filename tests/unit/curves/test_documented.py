"""Every family tells a reader what it is: formula, source, picture, in one sitting."""

import inspect

import pytest

from orientd.curves import METHODS


@pytest.mark.parametrize("name", METHODS)
def test_a_family_shows_its_formula_and_its_picture(name):
    text = inspect.getdoc(METHODS[name])
    assert ".. math::" in text
    assert f"``orientd plot {name}``" in text


@pytest.mark.parametrize("name", METHODS)
def test_a_family_names_its_source_and_what_it_is(name):
    family = METHODS[name]
    assert family.name == name
    assert any(character.isdigit() for character in family.source) or "extension" in family.source
    assert 20 <= len(family.summary) <= 80
    assert "\n" not in family.summary


@pytest.mark.parametrize("name", METHODS)
def test_a_module_of_a_family_can_be_read_in_one_sitting(name):
    source = inspect.getsource(inspect.getmodule(METHODS[name]))
    assert len(source.splitlines()) <= 650
