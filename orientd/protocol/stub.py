"""The calls of the control service for clients, made from the service's own description."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

from google.protobuf.message_factory import GetMessageClass

from orientd.protocol import control_pb2 as pb

if TYPE_CHECKING:
    import grpc


def control_stub(channel: grpc.Channel) -> SimpleNamespace:
    """Return the daemon's calls by their names in ``control.proto``.

    >>> control_stub(channel).GetState(GetStateRequest(), timeout=1.0)  # doctest: +SKIP
    """
    service, calls = pb.DESCRIPTOR.services_by_name["Control"], SimpleNamespace()
    for method in service.methods:
        kinds = (method.client_streaming, method.server_streaming)
        make = getattr(channel, "_".join("stream" if one else "unary" for one in kinds))
        call = make(
            f"/{service.full_name}/{method.name}",
            request_serializer=GetMessageClass(method.input_type).SerializeToString,
            response_deserializer=GetMessageClass(method.output_type).FromString,
        )
        setattr(calls, method.name, call)
    return calls
