"""Put words that readers search for in the index of the page that answers them.

The search of the site ranks a page by its title, so a page of the reference comes before a guide,
and the alphabet decides between guides.  An entry of the index comes first.
"""

from __future__ import annotations

from typing import Any

WORDS = {
    "explanation/limits": ["certificate", "safety"],
    "how-to/access": ["lease", "permissions", "roles", "tls", "who may move", "who may stop"],
    "how-to/library": [
        "quaternion order",
        "ros order",
        "ros order pose",
        "ros quaternion",
        "xyzw",
    ],
    "how-to/limits": [
        "acceleration limit",
        "set a speed limit",
        "set a velocity limit",
        "set speed limit",
        "speed limit",
        "velocity limit",
    ],
    "how-to/look-at": ["moving target"],
    "how-to/on-the-way": [
        "arm jerks when i retarget",
        "blend",
        "blend two moves",
        "e-stop",
        "emergency stop",
        "pause",
        "queue",
        "retarget",
        "slow down",
        "stop",
    ],
    "how-to/real-gimbal": ["camera gimbal park", "gimbal park", "own gimbal", "park"],
    "how-to/real-ur": [
        "connect a ur5e",
        "protective stop",
        "remote control",
        "reset after a protective stop",
        "ur5e",
    ],
    "how-to/service": ["autostart", "boot", "run at boot", "systemd"],
    "tutorials/record-replay": ["record"],
    "tutorials/tracking": ["follow a target"],
}
"""By page, in lower case, as the search compares them."""


def add(app: Any, page: str, source: list[str]) -> None:  # noqa: ANN401 - Sphinx's application
    """Add the entries of *page* below its title."""
    del app
    if page in WORDS:
        title, text = source[0].split("\n", 1)
        entries = ", ".join(f"! {word}" for word in WORDS[page])
        source[0] = f"{title}\n\n```{{index}} {entries}\n```\n{text}"
