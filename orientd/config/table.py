"""Base class of the tables of the configuration, and checks of their values."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

SOURCE = "source"
"""Key of the validation context: the name of the file, for messages about its settings."""


class Table(BaseModel):
    """A table of the settings: unknown keys are errors, and nothing is converted.

    Attributes:
        implied: fields that are no keys of the file.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    implied: ClassVar[frozenset[str]] = frozenset()


def checked(expected: str, convert: Callable[[Any], object]) -> BeforeValidator:
    """Return the check of a value: what *convert* raises on is not as *expected*."""

    def check(value: object) -> object:
        try:
            return convert(value)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            raise PydanticCustomError("expected", "{expected}", {"expected": expected}) from None

    return BeforeValidator(check)


def _expand(value: object) -> object:
    # TOML knows no paths; anything but text is left for the model to refuse.
    return Path(value).expanduser() if isinstance(value, str) else value


SomePath = Annotated[Path, BeforeValidator(_expand)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,31}$")]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
