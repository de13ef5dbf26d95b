"""The control service of a daemon, for what is measured around single calls."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import grpc

from orientd.rpc import Connection, Way

_TIMEOUT = 30.0


@contextlib.contextmanager
def control(socket: Path) -> Iterator[Any]:
    """Give a stub of the control service for as long as the context lasts.

    Args:
        socket: of the daemon.

    Raises:
        OrientdError: a call in the context failed, whatever gRPC said of it.
    """
    connection = Connection(Way(socket), timeout=_TIMEOUT)
    try:
        yield connection.stub
    except grpc.RpcError as error:
        raise connection.explain(error) from error
    finally:
        connection.close()
