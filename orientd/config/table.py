"""What every table of the configuration is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _expand(value: object) -> object:
    # TOML knows no paths; anything but text is left for the model to refuse.
    return Path(value).expanduser() if isinstance(value, str) else value


SomePath = Annotated[Path, BeforeValidator(_expand)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,31}$")]


class Table(BaseModel):
    """A table of the settings: unknown keys are errors, and nothing is converted."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
