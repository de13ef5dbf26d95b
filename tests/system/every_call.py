"""Make every call of the service as the current user, and report the result of each.

As a program, ``every_call.py SOCKET TOKEN UID GID [GROUP...]`` first changes from root to
that user.
"""

from __future__ import annotations

import json
import os
import sys

import grpc
from google.protobuf import message_factory

from orientd.protocol import control_pb2 as pb

SERVICE = pb.DESCRIPTOR.services_by_name["Control"]
TIMEOUT = 30.0  # s; of a machine under load


def requests(method, token):
    """Return messages that would change something, where a call of *method* may."""
    motion = b'{"keyframes": [{"rotation_vector": [0.2, 0, 0]}]}'
    known = {
        "Move": [pb.MoveRequest(lease_token=token, motion=motion)],
        "Plan": [pb.PlanRequest(motion=motion)],
        "SetSpeed": [pb.SetSpeedRequest(lease_token=token, speed=0.3)],
        "Track": [
            pb.TrackRequest(start=pb.TrackStart(lease_token=token)),
            pb.TrackRequest(target=pb.TrackTarget(orientation=pb.Quaternion(w=0.6, x=0.8))),
        ],
        "AcquireLease": [pb.AcquireLeaseRequest(holder="thief", beside=True)],
        "SeizeLease": [pb.SeizeLeaseRequest(holder="thief", reason="greed")],
    }
    if method.name in known:
        return known[method.name]
    request = message_factory.GetMessageClass(method.input_type)()
    for name in ("lease_token", "token"):
        if name in method.input_type.fields_by_name:
            setattr(request, name, token)
    return [request]


def call(channel, method, messages, *, timeout=TIMEOUT):
    """Return the name of the status with which a call ends, or has begun to answer."""
    path = f"/{SERVICE.full_name}/{method.name}"
    kind = "stream" if method.client_streaming else "unary"
    kind += "_stream" if method.server_streaming else "_unary"
    make = getattr(channel, kind)(path, request_serializer=_bytes, response_deserializer=bytes)
    asked = iter(messages) if method.client_streaming else messages[0]
    try:
        if method.server_streaming:
            answers = make(asked, timeout=timeout)
            next(answers, None)
            answers.cancel()
        else:
            make(asked, timeout=timeout)
    except grpc.RpcError as error:
        return error.code().name
    return "OK"


def _bytes(message):
    return message if isinstance(message, bytes) else message.SerializeToString()


def walk(channel, token="", skip=()):
    """Make every call; return the status of each by its name."""
    return {
        method.name: call(channel, method, requests(method, token))
        for method in SERVICE.methods
        if method.name not in skip
    }


if __name__ == "__main__":
    socket, token, uid, gid, *groups = sys.argv[1:]
    # Calls import some modules late, and the new user may not have access to them.
    with grpc.insecure_channel("unix:/dev/null") as nobody:
        walk(nobody)
    os.setgroups([int(group) for group in groups])
    os.setgid(int(gid))
    os.setuid(int(uid))
    with grpc.insecure_channel(f"unix:{socket}") as opened:
        print(json.dumps(walk(opened, token)), flush=True)
    # The threads of gRPC may hold up the end of the interpreter for minutes.
    os._exit(0)
