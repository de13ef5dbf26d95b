"""The control socket in virtual time: each call runs in the event loop of its daemon.

Requests and answers are serialised on their way, as they are by gRPC.  The daemon's own listener
identifies callers, and its own authorization serves their calls.
"""

from __future__ import annotations

import asyncio
import os
from collections import deque

import grpc
from grpclib.exceptions import GRPCError

from orientd.daemon.access.identity import Caller, Process
from orientd.daemon.access.listener import Listener
from orientd.errors import AccessError
from orientd.protocol.status import DETAILS_KEY

LATENCY = (0.0001, 0.002)
"""Least and most time that a request takes to the daemon, s; the seed decides."""

_CODES = {code.value[0]: code for code in grpc.StatusCode}


class CallError(grpc.RpcError, grpc.Call):
    """The end of a call that has no answer."""

    def __init__(self, code, details, metadata=()):
        super().__init__(details)
        self._code, self._details, self._metadata = code, details, metadata

    def code(self):
        return self._code

    def details(self):
        return self._details

    def trailing_metadata(self):
        return self._metadata

    def initial_metadata(self):
        return ()

    def is_active(self):
        return False

    def time_remaining(self):
        return None

    def cancel(self):
        return False

    def add_callback(self, callback):
        return False


def _error_of(error):
    """Return how a client gets to know of an exception in the daemon."""
    if isinstance(error, CallError):
        return error
    if isinstance(error, GRPCError):
        details = error.details
        metadata = () if details is None else ((DETAILS_KEY, details.SerializeToString()),)
        return CallError(_CODES[error.status.value], error.message, metadata)
    if isinstance(error, asyncio.CancelledError):
        return CallError(grpc.StatusCode.CANCELLED, "Locally cancelled by application!")
    return CallError(grpc.StatusCode.UNKNOWN, repr(error))


class VirtualListener(Listener):
    """The daemon's listener; clients reach it through the world."""

    world = None

    async def open(self, path):
        await super().open(path)
        self.loop = asyncio.get_running_loop()
        self.world.listeners[str(path)] = self
        self.world.present().at_end(self._leave)

    def _accept_at(self, listener, receive):
        listener.listen()  # nobody is accepted: the socket shows that it is taken
        self._listeners.append(listener)

    async def close(self, grace=0.0):
        await super().close(grace)
        self._leave()

    def _leave(self):
        self.world.listeners = {
            path: one for path, one in self.world.listeners.items() if one is not self
        }
        for listener in self._listeners:
            listener.close()
        for connection in list(self._connections):
            connection.hang_up()

    def connect(self):
        """Return a connection of the process that runs; ``None`` if the daemon hangs up on it."""
        process = Process(self.world.pid(), os.geteuid(), (os.getegid(), *os.getgroups()))
        connection = Connection(self)
        try:
            connection.caller = self._caller(process)
            self._enter(connection, connection.caller)
        except AccessError as error:
            self._refuse(str(process), str(error))
            return None
        return connection

    def _caller(self, process):
        identity = self.policy.identify(process)
        if identity is None:
            raise AccessError(f"no role admits {process}")
        return Caller(process, f"unix, process {process.pid}", identity)

    def route(self, path, connection):
        return self._find_route(path, connection.caller)

    def forget(self, connection):
        self._connections.pop(connection, None)


class Connection:
    """A client's connection, as the daemon's listener knows it.

    Attributes:
        caller: the client.
        calls: those that run.
        loop: of the daemon.
    """

    def __init__(self, listener):
        self._listener, self.loop = listener, listener.loop
        self.caller, self.calls = None, {}

    @property
    def is_idle(self):
        return not self.calls

    @property
    def is_open(self):
        return self._listener is not None

    def route(self, path):
        return self._listener.route(path, self)

    async def ends_within(self, seconds):
        if seconds and self.calls:
            await asyncio.sleep(0)
            ends = asyncio.get_running_loop().time() + seconds
            while self.calls and asyncio.get_running_loop().time() < ends:
                await asyncio.sleep(0.001)

    def hang_up(self):
        listener, self._listener = self._listener, None
        if listener is not None:
            listener.forget(self)
        for call in list(self.calls):
            call.cancel(CallError(grpc.StatusCode.UNAVAILABLE, "Socket closed"))


class _Stream:
    """A call as the daemon serves it, with the methods of grpclib's stream."""

    def __init__(self, call, parse, deserialize, requests):
        self._call, self._parse, self._deserialize = call, parse, deserialize
        self._requests = requests

    async def recv_message(self):
        request = await self._requests.get()
        return None if request is None else self._parse(request)

    async def send_message(self, answer):
        content = answer if isinstance(answer, bytes) else answer.SerializeToString()
        self._call.take(self._deserialize(content))


class _Ending(grpc.Call):
    """The end of a call, for which others wait.

    Attributes:
        is_over: whether it has ended.
    """

    def __init__(self, scheduler):
        self._scheduler, self._error, self.is_over = scheduler, None, False
        self._waiting, self._callbacks = [], []

    def end(self, error):
        """End with an error, or with none."""
        if self.is_over:
            return
        self._error, self.is_over = error, True
        for callback in self._callbacks:
            callback()
        self._wake()

    def _wake(self):
        for task in self._waiting:
            self._scheduler.wake(task)

    def _await(self, is_so):
        task = self._scheduler.current()
        self._waiting.append(task)
        try:
            while not is_so():
                self._scheduler.wait(None)
        finally:
            self._waiting.remove(task)

    def code(self):
        self._await(lambda: self.is_over)
        return grpc.StatusCode.OK if self._error is None else self._error.code()

    def details(self):
        self._await(lambda: self.is_over)
        return "" if self._error is None else self._error.details()

    def done(self):
        return self.is_over

    def is_active(self):
        return not self.is_over

    def time_remaining(self):
        return None

    def add_callback(self, callback):
        self._callbacks.append(callback)
        return True

    def add_done_callback(self, callback):
        if self.is_over:
            callback(self)
        else:
            self._callbacks.append(lambda: callback(self))

    def initial_metadata(self):
        return ()

    def trailing_metadata(self):
        return ()


class Answers(_Ending):
    """The answers of a call as they come."""

    def __init__(self, scheduler):
        super().__init__(scheduler)
        self._answers = deque()

    def take(self, answer):
        """Take an answer."""
        self._answers.append(answer)
        self._wake()

    def __iter__(self):
        return self

    def __next__(self):
        self._await(lambda: self._answers or self.is_over)
        if self._answers:
            return self._answers.popleft()
        if self._error is not None:
            raise self._error
        raise StopIteration

    next = __next__

    def result(self, timeout=None):
        answer = next(self, None)
        self._await(lambda: self.is_over)
        if self._error is not None:
            raise self._error
        return answer


class Call(Answers):
    """One call, which the daemon serves."""

    def __init__(self, world, connection, timeout):
        super().__init__(world.scheduler)
        self._connection, self._future = connection, None
        if timeout is not None:
            self._scheduler.spawn(lambda: self._expire(timeout), "deadline")

    def begin(self, path, given, kinds):
        """Have the daemon serve a call of the full name *path*, with the serialised *given*."""
        connection = self._connection
        if connection is None:
            self.end(CallError(grpc.StatusCode.UNAVAILABLE, "failed to connect: no daemon"))
            return
        connection.calls[self] = None
        serving = self._serve(path, given, *kinds)
        self._future = asyncio.run_coroutine_threadsafe(serving, connection.loop)

    async def _serve(self, path, given, is_one, deserialize):
        try:
            await asyncio.sleep(self._scheduler.random.uniform(*LATENCY))
            route = self._connection.route(path)
            if route is None:
                raise CallError(grpc.StatusCode.UNIMPLEMENTED, "Method not found")
            requests = asyncio.Queue()
            if is_one:
                for request in (*given, None):
                    requests.put_nowait(request)
            else:
                self._scheduler.spawn(lambda: self._feed(given, requests), "requests")
            stream = _Stream(self, route.request_type.FromString, deserialize, requests)
            await route.func(stream)
        except BaseException as error:
            self.end(_error_of(error))
            if isinstance(error, asyncio.CancelledError):
                raise
        self.end(None)

    def _feed(self, given, requests):
        put = self._connection.loop.call_soon_threadsafe
        for request in given:
            if self.is_over:
                return
            put(requests.put_nowait, request)
        if not self.is_over:
            put(requests.put_nowait, None)

    def _expire(self, timeout):
        self._scheduler.sleep(timeout)
        self.cancel(CallError(grpc.StatusCode.DEADLINE_EXCEEDED, "Deadline Exceeded"))

    def end(self, error):
        """End with an error, or with none."""
        if not self.is_over and self._connection is not None:
            self._connection.calls.pop(self, None)
        super().end(error)

    def cancel(self, error=None):
        if not self.is_over:
            self.end(error or _error_of(asyncio.CancelledError()))
            if self._future is not None and not self._connection.loop.is_closed():
                self._connection.loop.call_soon_threadsafe(self._future.cancel)
        return True


class Channel:
    """A channel to the daemon at a path, as gRPC's."""

    def __init__(self, world, socket):
        self._world, self._socket = world, socket
        self._connection, self._is_closed, self._calls = None, False, {}
        present = world.present()
        if present is not None:
            present.at_end(self.close)

    def unary_unary(self, path, request_serializer, response_deserializer):
        def begin(request, timeout=None, **_):
            given = [request_serializer(request)]
            return self._begin(path, given, timeout, True, response_deserializer)

        def call(request, timeout=None, metadata=None, **_):
            return begin(request, timeout).result()

        call.future = begin
        return call

    def unary_stream(self, path, request_serializer, response_deserializer):
        def begin(request, timeout=None, **_):
            given = [request_serializer(request)]
            return self._begin(path, given, timeout, True, response_deserializer)

        return begin

    def stream_stream(self, path, request_serializer, response_deserializer):
        def begin(requests, timeout=None, **_):
            given = map(request_serializer, requests)
            return self._begin(path, given, timeout, False, response_deserializer)

        return begin

    def _begin(self, path, given, timeout, *kinds):
        if self._is_closed:
            raise ValueError("Cannot invoke RPC on closed channel!")
        if self._connection is None or not self._connection.is_open:
            listener = self._world.listeners.get(str(self._socket))
            self._connection = None if listener is None else listener.connect()
        call = Call(self._world, self._connection, timeout)
        self._calls[call] = None
        call.add_callback(lambda: self._calls.pop(call, None))
        call.begin(path, given, kinds)
        return call

    def close(self):
        self._is_closed = True
        for call in list(self._calls):
            call.cancel()
        if self._connection is not None:
            self._connection.hang_up()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
