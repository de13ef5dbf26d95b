"""Health and reflection, as generic clients ask for them: grpclib's, behind our authorization.

This is imported by a daemon alone: the messages are those that generic clients of Python have, too,
and one process cannot register both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from grpclib.const import Handler
from grpclib.health.check import ServiceStatus
from grpclib.health.service import Health
from grpclib.reflection.service import ServerReflection

from orientd.daemon.access.authorization import Method

_REFLECTION = ("grpc.reflection.v1.ServerReflection", "grpc.reflection.v1alpha.ServerReflection")


class _Named:
    """A service by its name alone, as the library asks for it."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __mapping__(self) -> dict[str, Any]:
        return {f"/{self._name}/": None}


def standard_methods(service: str, status: ServiceStatus) -> Mapping[str, Method]:
    """Return the calls of health and reflection.

    Args:
        service: full name of the daemon's service.
        status: health of that service.
    """
    offered = _Named(service)
    health = Health({offered: [status]})
    listed: list[Any] = [offered, health, *map(_Named, _REFLECTION)]
    handlers: dict[str, Handler] = dict(health.__mapping__())
    for reflection in ServerReflection.extend(listed)[len(listed) :]:
        handlers |= reflection.__mapping__()
    return {
        path: Method(
            path.rpartition("/")[2], found.func, found.request_type, found.cardinality, True
        )
        for path, found in handlers.items()
    }
