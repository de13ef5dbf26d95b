"""Calls that no client would make, many at a time over a few channels.

Random bytes, requests with bytes changed, and valid requests without a sensible meaning.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import itertools
import json
import math
from collections import Counter

import grpc
from every_call import SERVICE, requests
from google.protobuf import message_factory

from orientd.model.orientation import FORMS
from orientd.model.request import MotionRequest
from orientd.protocol import control_pb2 as pb

CHANNELS = 4
AT_ONCE = 16
"""Calls over one channel; all of them stay below what one identity may have open."""

PATIENCE = 3.0
"""s that a call may take."""

TOKENS = ("", "0" * 32, "\ud7ff" * 9)
"""Of no lease; a stop, or a plan, needs none."""

FLOATS = (0.0, -0.0, 1.0, math.nan, math.inf, -math.inf, 1e-320, 1e300, -1e18, 1e-9, 1e9)
TEXTS = ("", "arm", "leg", "a" * 5000, "\x00", "../../etc/passwd", "\U0001f916", *TOKENS[1:])

REQUESTS = {
    (method.name, token): [message.SerializeToString() for message in requests(method, token)]
    for method, token in itertools.product(SERVICE.methods, TOKENS)
}


def mutated(rng, content):
    """Return *content* with bytes changed, left out, doubled, or put in."""
    content = bytearray(content)
    for _ in range(rng.randint(1, 8)):
        place = rng.randrange(len(content) + 1)
        match rng.randrange(4):
            case 0 if content:
                content[place % len(content)] = rng.randrange(256)
            case 1:
                del content[place : place + rng.randint(1, 8)]
            case 2:
                content[place:place] = content[place : place + rng.randint(1, 64)]
            case _:
                content[place:place] = rng.randbytes(rng.randint(1, 8))
    return bytes(content)


def fill(rng, message, depth=0):
    """Set fields of *message* to anything that their types allow; return it."""
    for field in message.DESCRIPTOR.fields:
        if rng.random() < 0.4 or (depth > 3 and field.message_type):
            continue
        if field.is_repeated and field.message_type and field.message_type.GetOptions().map_entry:
            continue
        if field.is_repeated:
            many = getattr(message, field.name)
            for _ in range(rng.choice((0, 1, 2, 5, 40))):
                if field.message_type:
                    fill(rng, many.add(), depth + 1)
                else:
                    many.append(anything(rng, field))
        elif field.message_type:
            inner = getattr(message, field.name)
            inner.SetInParent()
            fill(rng, inner, depth + 1)
        else:
            setattr(message, field.name, anything(rng, field))
    return message


def anything(rng, field):
    """Return something that *field* can hold."""
    if field.enum_type:
        return rng.choice([value.number for value in field.enum_type.values] + [99, -1])
    match field.cpp_type:
        case field.CPPTYPE_DOUBLE | field.CPPTYPE_FLOAT:
            return rng.choice((rng.uniform(-2, 2), rng.uniform(0, 1), *FLOATS))
        case field.CPPTYPE_BOOL:
            return rng.random() < 0.5
        case field.CPPTYPE_STRING if field.type == field.TYPE_BYTES:
            columns = fill(rng, pb.KeyframeColumns()).SerializeToString()
            motion = some_motion(rng)
            parts = motion, motion[:-3], columns, columns[:-3], rng.randbytes(rng.randrange(50))
            return rng.choice(parts)
        case field.CPPTYPE_STRING:
            return rng.choice(TEXTS)
        case field.CPPTYPE_INT32:
            return rng.choice((0, 1, -1, 2**31 - 1, -(2**31)))
        case field.CPPTYPE_INT64:
            return rng.choice((0, 1, -1, 2**63 - 1, -(2**63)))
        case field.CPPTYPE_UINT32:
            return rng.choice((0, 1, 7, 2**32 - 1))
        case field.CPPTYPE_UINT64:
            return rng.choice((0, 1, 7, 2**64 - 1))
    return rng.randbytes(rng.randrange(50))


def some_motion(rng):
    """Return the text of a motion whose values are anything."""
    values = (*FLOATS, *TEXTS, True, None, [], {}, [0, 0, 1], {"w": 1, "x": 0, "y": 0, "z": 0})
    names = [field.name for field in dataclasses.fields(MotionRequest)]
    forms = rng.choices((*FORMS, "time", "position", "turns", "name"), k=2)
    keyframes = [{key: rng.choice(values) for key in forms} for _ in range(rng.choice((1, 2, 5)))]
    fields = {key: rng.choice(values) for key in rng.sample(names, 2) if rng.random() < 0.5}
    return json.dumps({"keyframes": keyframes, **fields}).encode()


def some_nonsense(rng, without=()):
    """Return a method, none of those named, and what to call it with.

    A lease from such a request does no harm, because no client knows its token.
    """
    method = rng.choice([one for one in SERVICE.methods if one.name not in without])
    match rng.randrange(3):
        case 0:
            return method, [rng.randbytes(rng.randrange(200)) for _ in range(rng.randint(1, 3))]
        case 1:
            messages = REQUESTS[method.name, rng.choice(TOKENS)]
            return method, [mutated(rng, message) for message in messages]
    kind = message_factory.GetMessageClass(method.input_type)
    filled = [fill(rng, kind()) for _ in range(rng.randint(1, 3))]
    return method, [message.SerializeToString() for message in filled]


def ways_over(channel):
    """Return what makes each call with bytes as they are, by the name of its method."""
    ways = {}
    for method in SERVICE.methods:
        kind = "stream" if method.client_streaming else "unary"
        kind += "_stream" if method.server_streaming else "_unary"
        ways[method.name] = getattr(channel, kind)(f"/{SERVICE.full_name}/{method.name}")
    return ways


async def call(ways, method, messages):
    """Return the name of the status with which a call ends, or has begun to answer."""
    asked = iter(messages) if method.client_streaming else messages[0]
    made = ways[method.name](asked, timeout=PATIENCE)
    try:
        if not method.server_streaming:
            await made
        elif await made.read() is grpc.aio.EOF:
            return (await made.code()).name
    except grpc.aio.AioRpcError as error:
        # So the library calls a stream that was answered before all of it was sent.
        is_cut_short = error.details() == "Internal error from Core"
        return "CUT SHORT" if is_cut_short else error.code().name
    except asyncio.CancelledError:
        # The library cancels a stream that is answered while it sends a request.
        if not made.cancelled():
            raise
        return "CUT SHORT"
    finally:
        made.cancel()
    return "OK"


async def _pour(socket, rng, count, without):
    codes = Counter()
    left = itertools.repeat(None, count)

    async def keep_calling(ways):
        for _ in left:
            method, messages = some_nonsense(rng, without)
            codes[method.name, await call(ways, method, messages)] += 1

    # Each with a connection of its own.
    options = (("grpc.use_local_subchannel_pool", 1),)
    async with contextlib.AsyncExitStack() as stack:
        workers = []
        for _ in range(CHANNELS):
            opened = grpc.aio.insecure_channel(f"unix:{socket}", options)
            ways = ways_over(await stack.enter_async_context(opened))
            workers += [keep_calling(ways) for _ in range(AT_ONCE)]
        await asyncio.gather(*workers)
    return codes


def pour(socket, rng, count, without=()):
    """Make *count* calls; return how many ended with each status, by method and status."""
    return asyncio.run(_pour(socket, rng, count, without))
