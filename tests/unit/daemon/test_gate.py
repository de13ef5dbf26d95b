"""The gate lets early calls wait, and hinders nobody else."""

import asyncio
from types import SimpleNamespace

import grpc

from orientd.daemon.access.gate import StartupGate

EARLY = SimpleNamespace(method="/a.Service/Call")
OTHER = SimpleNamespace(method="/b.Health/Check")


def register(gate):
    """Add a service as generated code does."""
    handlers = {"Call": grpc.unary_unary_rpc_method_handler(lambda request, context: request)}
    gate.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("a.Service", handlers),))
    gate.add_registered_method_handlers("a.Service", handlers)


async def found(gate, details):
    async def continuation(asked):
        return gate.service(asked) or "elsewhere"

    return await gate.intercept_service(continuation, details)


def test_early_calls_wait_until_the_gate_opens():
    async def run():
        gate = StartupGate("a.Service", lambda name, handler: handler)
        early = asyncio.create_task(found(gate, EARLY))
        assert await found(gate, OTHER) == "elsewhere"
        assert not early.done()
        gate.open(register)
        assert (await early).unary_unary is not None
        assert (await found(gate, EARLY)).unary_unary is not None

    asyncio.run(run())


def test_what_is_behind_the_gate_is_found_by_its_name_only():
    gate = StartupGate("a.Service", lambda name, handler: handler)
    assert gate.service(EARLY) is None
    register(gate)
    assert gate.service(EARLY) is not None
    assert gate.service(OTHER) is None
