"""Motions as clients send them, for tests that build requests by hand."""

from __future__ import annotations

import json

from orientd import motion_file
from orientd.client.motion_text import motion_text
from orientd.protocol.columns import keyframe_rows


def motion_of(*keyframes, **fields) -> bytes:
    """Return the text of a motion file with these keyframes, each as a mapping."""
    return json.dumps({"keyframes": list(keyframes), **fields}).encode()


def through(vectors, **fields) -> bytes:
    """Return the text of a motion through orientations given by rotation vectors."""
    return motion_of(*({"rotation_vector": [*map(float, v)]} for v in vectors), **fields)


def read(keyframes, **fields):
    """Return the request that the planner reads of what the client sends."""
    sent = motion_text(keyframes, **fields)
    rows = keyframe_rows(sent.columns, 200_000) if sent.columns else ()
    return motion_file.loads(sent.text, sent.source, rows=rows)
