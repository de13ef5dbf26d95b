"""Fixtures of pytest: an emulated robot, and a factory for more."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from emulated_ur.process import EmulatedRobot


@pytest.fixture
def emulated_ur_factory() -> Iterator[Callable[..., EmulatedRobot]]:
    """Start robots with options of the command: `emulated_ur_factory("--model", "ur10e")`."""
    with ExitStack() as stack:
        yield lambda *options: stack.enter_context(EmulatedRobot(None, *options))


@pytest.fixture
def emulated_ur(emulated_ur_factory: Callable[..., EmulatedRobot]) -> EmulatedRobot:
    """A running UR5e on its own address; `host` names it."""
    return emulated_ur_factory()
