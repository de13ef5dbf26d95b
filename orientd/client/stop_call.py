"""A stop that goes directly to the servos, independent of the daemon.

:mod:`orientd.servo.stop_socket` defines the requests and the answers.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from orientd.client.trust import check_folder, check_uid
from orientd.errors import AccessError, DaemonError
from orientd.first_stop import Answers, send, stop_folder


def ask_to_stop(
    socket_path: Path, kind: str, device: str = "", *, answers: Answers | None = None
) -> list[dict[str, Any]] | None:
    """Stop devices; return what each was doing, or ``None`` if no servo can be asked.

    Args:
        socket_path: of the daemon.
        kind: ``stop``, or ``halt`` for the fastest stop, off the path.
        device: its name; empty for all of them.
        answers: of the servos that were asked already; see :mod:`orientd.first_stop`.

    Returns:
        For each device its ``name``, ``state`` and ``motion`` at the stop.

    Raises:
        AccessError: this user is not admitted.
        DaemonError: a servo does not answer, or its user is not trusted.
    """
    folder = Path(stop_folder(str(socket_path)))
    try:
        if answers is None:
            answers = send(str(socket_path), kind, device)
    except PermissionError as error:
        raise AccessError(f"{folder} does not admit user {os.geteuid()}") from error
    except OSError:
        return None  # such as too many open files: the daemon may still be asked
    if answers is None:
        return None
    check_folder(folder.absolute())
    stopped: list[dict[str, Any]] = []
    silent: list[str] = []
    for name in sorted(answers):
        answer, uid = answers[name]
        if uid < 0:
            silent.append(name)
            continue
        check_uid(folder / name, uid)
        word, *met = answer.split()
        if word == "refused":
            raise AccessError(f"the daemon at {socket_path} refuses: user {met[0]} is not admitted")
        state, motion = met
        stopped.append({"name": name, "state": state, "motion": int(motion)})
    check_answered(kind, dict.fromkeys(silent, ""), [one["name"] for one in stopped])
    return stopped


def check_answered(kind: str, silent: Mapping[str, str], stopped: Iterable[str]) -> None:
    """Check that every servo has answered a stop: silence never counts as stopped.

    Args:
        kind: ``stop`` or ``halt``.
        silent: each device whose servo has not answered, with the reason if that is known.
        stopped: the devices whose servos have.

    Raises:
        DaemonError: a servo has not answered.
    """
    if not silent:
        return
    may = "it may still move" if len(silent) == 1 else "they may still move"
    reasons = "; ".join(f"{name}: {reason}" for name, reason in silent.items() if reason)
    why = f" ({reasons})" if reasons else ""
    told = ", ".join(stopped)
    rest = f"; told to stop: {told}" if told else ""
    raise DaemonError(f"no servo of {', '.join(silent)} answers the {kind}: {may}{why}{rest}")


def refusal(socket_path: Path) -> str:
    """Return why the daemon at *socket_path* does not admit this user; empty if it does."""
    try:
        answers = send(str(socket_path), "hello") or {}
    except PermissionError:
        return f"{stop_folder(str(socket_path))} does not admit user {os.geteuid()}"
    is_refused = any(answer.startswith("refused") for answer, _ in answers.values())
    return f"user {os.geteuid()} is not admitted" if is_refused else ""
