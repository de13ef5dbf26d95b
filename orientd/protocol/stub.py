"""The calls of the control service for clients, made from the service's own description."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from google.protobuf.message_factory import GetMessageClass

from orientd.protocol import control_pb2 as pb

if TYPE_CHECKING:
    import grpc

_SERVICE = pb.DESCRIPTOR.services_by_name["Control"]


class ControlStub:
    """Call the daemon: ``stub.GetState(request, timeout=...)``, by the names of ``control.proto``.

    Each call is a multi-callable of gRPC, made when it is first used.
    """

    def __init__(self, channel: grpc.Channel) -> None:
        """Call over *channel*."""
        self._channel = channel

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - one of gRPC's four kinds
        method = _SERVICE.methods_by_name.get(name)
        if method is None:
            raise AttributeError(f"{_SERVICE.full_name} has no call {name!r}")
        kinds = (method.client_streaming, method.server_streaming)
        make = getattr(self._channel, "_".join("stream" if one else "unary" for one in kinds))
        call = make(
            f"/{_SERVICE.full_name}/{name}",
            request_serializer=GetMessageClass(method.input_type).SerializeToString,
            response_deserializer=GetMessageClass(method.output_type).FromString,
        )
        setattr(self, name, call)
        return call
