"""`orientd stop` and `orientd halt`, on their way before the command line is loaded.

Typer, with the library it checks options by, takes some 0.2 s to load and gRPC's library 0.1 s
more, in which what moves would move on; all of this takes 40 ms.  What these two commands are
plainly asked for is read here, without both; whatever is not plain, and whatever goes wrong, is
left to the command line, which asks the daemon again.
"""

from __future__ import annotations

import os

from orientd.rpc import begin_call, found_socket, read_answer, text_fields

_METHODS = {"stop": "Stop", "halt": "Halt"}
_OPTIONS = {"--socket": "socket", "--device": "device", "-d": "device"}


def run(arguments: list[str]) -> bool:
    """Carry out the command that *arguments* say; return whether that is done."""
    method = _METHODS.get(arguments[0]) if arguments else None
    given = _options(arguments[1:]) if method else None
    if method is None or given is None:
        return False
    socket = given.get("socket") or os.environ.get("ORIENTD_SOCKET")
    if not socket and os.environ.get("ORIENTD_ADDRESS"):
        return False
    path = socket or str(found_socket())
    caller = f"orientd {arguments[0]}, process {os.getpid()}"
    try:
        message = text_fields(given.get("device", ""), caller)
    except ValueError:
        return False
    connection = begin_call(path, f"orientd.v1.Control/{method}", message)
    if connection is None:
        return False

    # It is sent: from here on nothing is in a hurry.
    from orientd.cli import output
    from orientd.cli.at_rest import tell
    from orientd.rpc import device_from_message
    from orientd.rpc.control_pb2 import StopResponse

    content = read_answer(connection)
    if content is None:
        return False
    # A HaltResponse is the same on the wire.
    reports = [device_from_message(report) for report in StopResponse.FromString(content).devices]
    try:
        tell(reports, as_json="json" in given)
    except BrokenPipeError:
        output.close_output()
        raise SystemExit(1) from None
    return True


def _options(arguments: list[str]) -> dict[str, str] | None:
    """Return the options in *arguments* by name, or ``None`` where there is anything else."""
    given: dict[str, str] = {}
    waiting = iter(arguments)
    for argument in waiting:
        value = "" if argument == "--json" else next(waiting, "")
        name = "json" if argument == "--json" else _OPTIONS.get(argument)
        if name is None or (name != "json" and (not value or value.startswith("-"))):
            return None
        given[name] = value
    return given
