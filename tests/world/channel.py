"""The control socket in virtual time: each call runs in the event loop of its daemon.

Requests and answers are serialised on their way, as they are by gRPC.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque

import grpc

from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.status import DETAILS_KEY, to_status

LATENCY = (0.0001, 0.002)
"""Least and most time that a request takes to the daemon, s; the seed decides."""

_CODES = {code.value[0]: code for code in grpc.StatusCode}
_METHODS = pb.DESCRIPTOR.services_by_name["Control"].methods_by_name


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
    if isinstance(error, OrientdError):
        status = to_status(error)
        details = ((DETAILS_KEY, status.SerializeToString()),)
        return CallError(_CODES[status.code], status.message, details)
    if isinstance(error, asyncio.CancelledError):
        return CallError(grpc.StatusCode.CANCELLED, "Locally cancelled by application!")
    return CallError(grpc.StatusCode.UNKNOWN, repr(error))


class Call(grpc.Call):
    """One call: its answers as they come, and its end.

    Attributes:
        is_over: whether it has ended.
    """

    def __init__(self, scheduler, daemon, timeout):
        self._scheduler, self._daemon = scheduler, daemon
        self._answers, self._waiting, self._callbacks = deque(), [], []
        self._error, self._future = None, None
        self.is_over = False
        if timeout is not None:
            scheduler.spawn(lambda: self._expire(timeout), "deadline")

    def begin(self, answers):
        """Have the daemon answer with the items of an asynchronous iterator."""
        if self._daemon is None:
            self.end(CallError(grpc.StatusCode.UNAVAILABLE, "failed to connect: no daemon"))
            return
        self._daemon.calls.add(self)
        self._future = asyncio.run_coroutine_threadsafe(self._pump(answers), self._daemon.loop)

    async def _pump(self, answers):
        try:
            async with contextlib.aclosing(answers):
                async for answer in answers:
                    self._answers.append(answer)
                    self._wake()
        except BaseException as error:
            self.end(_error_of(error))
            raise
        self.end(None)

    def _expire(self, timeout):
        self._scheduler.sleep(timeout)
        self.cancel(CallError(grpc.StatusCode.DEADLINE_EXCEEDED, "Deadline Exceeded"))

    def end(self, error):
        """End with an error, or with none."""
        if self.is_over:
            return
        self._error, self.is_over = error, True
        if self._daemon is not None:
            self._daemon.calls.discard(self)
        for callback in self._callbacks:
            callback()
        self._wake()

    def cancel(self, error=None):
        if not self.is_over:
            self.end(error or _error_of(asyncio.CancelledError()))
            self._daemon.loop.call_soon_threadsafe(self._future.cancel)
        return True

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


class Channel:
    """A channel to the daemon at a path, as gRPC's."""

    def __init__(self, world, socket):
        self._world, self._socket = world, socket
        self._is_closed, self._calls = False, []

    def unary_unary(self, path, request_serializer, response_deserializer):
        begin = self._beginning(path, request_serializer, response_deserializer)

        def call(request, timeout=None, metadata=None, **_):
            return begin(request, timeout).result()

        call.future = lambda request, timeout=None, **_: begin(request, timeout)
        return call

    def unary_stream(self, path, request_serializer, response_deserializer):
        begin = self._beginning(path, request_serializer, response_deserializer)
        return lambda request, timeout=None, **_: begin(request, timeout)

    def stream_stream(self, path, request_serializer, response_deserializer):
        begin = self._beginning(path, request_serializer, response_deserializer)
        return lambda requests, timeout=None, **_: begin(requests, timeout)

    def _beginning(self, path, serialize, deserialize):
        """Return what begins a call of a method."""
        world, method = self._world, _METHODS[path.rpartition("/")[2]]
        parse = pb.__dict__[method.input_type.name].FromString

        def begin(given, timeout):
            if self._is_closed:
                raise ValueError("Cannot invoke RPC on closed channel!")
            daemon = world.daemon_at(self._socket)
            call = Call(world.scheduler, daemon, timeout)
            self._calls.append(call)
            if daemon is None:
                call.begin(None)
                return call
            work = getattr(daemon.service, method.name)

            async def answers():
                await asyncio.sleep(world.scheduler.random.uniform(*LATENCY))
                request = given if not method.client_streaming else received()
                if not method.client_streaming:
                    request = parse(serialize(given))
                answer = work(request, daemon.caller)
                if method.server_streaming:
                    async for one in answer:
                        yield deserialize(_bytes(one))
                else:
                    yield deserialize(_bytes(await answer))

            async def received():
                queue = asyncio.Queue()
                world.scheduler.spawn(lambda: feed(queue), "requests")
                while (request := await queue.get()) is not None:
                    yield parse(request)

            def feed(queue):
                for request in given:
                    if call.is_over:
                        return
                    daemon.loop.call_soon_threadsafe(queue.put_nowait, serialize(request))
                daemon.loop.call_soon_threadsafe(queue.put_nowait, None)

            call.begin(answers())
            return call

        return begin

    def close(self):
        self._is_closed = True
        for call in self._calls:
            call.cancel()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def _bytes(answer):
    return answer if isinstance(answer, bytes) else answer.SerializeToString()
