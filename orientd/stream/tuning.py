"""A driver's options of a motion, as they cross to the servo."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from orientd.stream.records import TUNING_TEXT_BYTES


def tuning_text(options: Mapping[str, Any]) -> bytes:
    """Return *options* as they cross to the servo.

    Raises:
        ValueError: they are too long, or more than JSON can say.
    """
    try:
        text = json.dumps(dict(options), allow_nan=False).encode()
    except TypeError as error:
        raise ValueError(str(error)) from error
    if len(text) > TUNING_TEXT_BYTES:
        raise ValueError(f"at most {TUNING_TEXT_BYTES} bytes of JSON are allowed, got {len(text)}")
    return text
