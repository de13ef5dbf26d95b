"""Plan from Python without a daemon: orientations in, a certified motion out.

Many requests can be planned at once on every core of this machine, or on a cluster.  Joblib
distributes the work to its own processes (``loky``), to Ray or to Dask.  The results are the same
for all of them, in the order of the requests.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import itertools
import os
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from importlib.util import find_spec
from typing import Any, Literal, TypeVar, get_args

from numpy.typing import ArrayLike

from orientd.errors import OrientdError, RequestError
from orientd.model.keyframes import keyframe_mappings
from orientd.model.limits import DEFAULT_LIMITS, Limits, Rate
from orientd.model.request import MotionRequest
from orientd.planner.motion import Motion
from orientd.planner.planning import plan
from orientd.planner.resolve import in_device_coordinates
from orientd.planner.state import State
from orientd.spelling import unknown_key

Part = TypeVar("Part")
Result = TypeVar("Result")
Backend = Literal["loky", "ray", "dask"]

BACKENDS: tuple[str, ...] = get_args(Backend)

_TOGETHER = 64
"""Requests per batch of a worker."""

_IDLE = 30.0
"""Seconds after which an idle worker ends."""

_LOOK = 1.0
"""Seconds between checks whether the parent process still runs."""

_PATIENCE = 5.0
"""Timeout of a connection to a cluster, s."""

_ROUNDS = 8
"""Parts that each Ray worker receives before results are returned."""

_NEEDED = {
    "loky": ("joblib", "orientd-motion[batch]"),
    "ray": ("ray", "ray"),
    "dask": ("distributed", "dask[distributed]"),
}


def plan_offline(
    keys: Iterable[object] | MotionRequest,
    *,
    times: ArrayLike | None = None,
    positions: ArrayLike | None = None,
    turns: ArrayLike | None = None,
    limits: Limits | Mapping[str, Rate] | None = None,
    period: float = 0.002,
    start: State | None = None,
    unix_ns: int | None = None,
    **fields: Any,  # noqa: ANN401 - the arguments of a request
) -> Motion:
    """Return the motion through keyframes, certified as for a device.

    Args:
        keys: SciPy ``Rotation``; list of ``Rotation``, ``Quaternion`` or mappings as in a motion
            file; or a :class:`.MotionRequest`.  With a request give only *limits*, *period*,
            *start* and *unix_ns*.
        times: time of each keyframe, s; ``None`` passes them as fast as the limits permit.
        positions: of the tool, m, shape ``(n, 3)``.
        turns: whole turns in each interval, shape ``(n - 1,)``.
        limits: of the device; a mapping replaces some of :data:`.DEFAULT_LIMITS`, and ``None`` uses
            these.
        period: of the device, s.
        start: state of the device; by default at rest at the first keyframe.
        unix_ns: Unix time at the beginning of the motion, ns, for keep-out cones that move; by
            default the time of this call.
        fields: further arguments of :class:`.MotionRequest`: ``method``, ``start_velocity``,
            ``end_velocity``, ``velocity_frame``, ``approach``, ``duration``, ``pace``,
            ``options``, ``frame``, ``frames``.

    Raises:
        RequestError: a value is malformed, or the method cannot do it.
        PlanError: the motion cannot be planned, or would break a limit.
        TypeError: a field is given together with a request.
    """
    unix_ns = time.time_ns() if unix_ns is None else unix_ns
    if isinstance(keys, MotionRequest):
        columns = {"times": times, "positions": positions, "turns": turns}
        beside = [*fields, *(name for name, column in columns.items() if column is not None)]
        if beside:
            raise TypeError(f"a whole request has its own {beside[0]}, got another")
        request = keys
    else:
        known = [one.name for one in dataclasses.fields(MotionRequest) if one.name != "keyframes"]
        for name in fields:
            if name not in known:
                expected = ["times", "positions", "turns", "limits", "period", "start", *known]
                raise RequestError(name, unknown_key(name, expected))
        mappings: Any = keyframe_mappings(keys, times=times, positions=positions, turns=turns)
        request = MotionRequest(mappings, **fields)
    request = in_device_coordinates(request, start)
    if start is None:
        start = State.at_rest(request.keys[0], request.keyframes[0].position or (0.0, 0.0, 0.0))
    if not isinstance(limits, Limits):
        limits = DEFAULT_LIMITS.with_rates(limits or {})
    return plan(request, start=start, limits=limits, period=period, unix_ns=unix_ns)


def plan_many(
    requests: Iterable[MotionRequest],
    *,
    limits: Limits = DEFAULT_LIMITS,
    period: float = 0.002,
    backend: Backend = "loky",
    jobs: int = -1,
    address: str | None = None,
    unix_ns: int | None = None,
) -> Iterator[Motion | OrientdError]:
    """Yield the motion of each request in order, or the error of a refused one.

    Args:
        requests: each begins at rest at its first keyframe; consumed as needed.
        limits: of the device.
        period: of the device, s.
        backend: distributes the work; see :func:`in_parallel`.
        jobs: number of parallel workers; -1 for one on each core.
        address: of a Ray or Dask cluster; by default one starts on this machine.
        unix_ns: as in :func:`plan_offline`, for all motions.

    Raises:
        OrientdError: the backend is not installed.
    """
    unix_ns = time.time_ns() if unix_ns is None else unix_ns
    waiting = iter(requests)
    parts = iter(lambda: list(itertools.islice(waiting, _TOGETHER)), [])
    work = partial(_plan, limits=limits, period=period, unix_ns=unix_ns)
    for planned in in_parallel(work, parts, backend=backend, jobs=jobs, address=address):
        yield from planned


def _plan(
    requests: list[MotionRequest], *, limits: Limits, period: float, unix_ns: int
) -> list[Motion | OrientdError]:
    found: list[Motion | OrientdError] = []
    for request in requests:
        try:
            found.append(plan_offline(request, limits=limits, period=period, unix_ns=unix_ns))
        except OrientdError as error:
            found.append(error)
    return found


def in_parallel(
    work: Callable[[Part], Result],
    parts: Iterable[Part],
    *,
    backend: str = "loky",
    jobs: int = -1,
    address: str | None = None,
) -> Iterator[Result]:
    """Yield the result of *work* for each part, in order.

    Args:
        work: a module-level function, so that other processes find it.
        parts: consumed as needed.
        backend: ``loky`` for processes on this machine, ``ray`` or ``dask`` for a cluster.
        jobs: number of parallel workers; -1 for one on each core.
        address: of the cluster; by default one starts on this machine.

    Raises:
        OrientdError: the backend is unknown, not installed, or unreachable.
    """
    need_backend(backend)
    import joblib

    of_loky = {
        "idle_worker_timeout": _IDLE,
        "initializer": _settle,
        "initargs": (work, os.getpid()),
    }
    more: dict[str, Any] = of_loky if backend == "loky" else {}
    with _cluster(backend, address), joblib.parallel_config(backend, n_jobs=jobs, **more):
        tasks = (joblib.delayed(work)(part) for part in parts)
        # One part at a time: they are large, and the next request depends on the pace of the
        # caller.
        if backend != "ray":
            parallel = joblib.Parallel(
                return_as="generator", batch_size=1, pre_dispatch="2 * n_jobs"
            )
            yield from parallel(tasks)
            return
        # Joblib's Ray backend returns lists only.
        with joblib.Parallel(batch_size=1) as parallel:
            together = _ROUNDS * joblib.effective_n_jobs(jobs)
            while some := list(itertools.islice(tasks, together)):
                yield from parallel(some)


def _settle(work: object, asker: int) -> None:
    """Prepare a worker that keeps no memory between parts and does not outlive the *asker*.

    Garbage collection after each part skips the objects loaded so far for *work*.
    """
    del work
    gc.collect()
    gc.freeze()
    threading.Thread(target=_end_with, args=(asker,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process, whatever it waits for, once its parent has ended."""
    # The kernel's PR_SET_PDEATHSIG depends on the thread that started the worker, so it does not
    # help.
    while os.getppid() == parent:
        time.sleep(_LOOK)
    os._exit(1)


def need_backend(backend: str) -> None:
    """Raise :class:`.OrientdError` if a backend is unknown or not installed."""
    if backend not in BACKENDS:
        raise OrientdError(f"expected a backend of {', '.join(BACKENDS)}, got {backend!r}")
    for module, package in dict.fromkeys((_NEEDED["loky"], _NEEDED[backend])):
        if find_spec(module) is None:
            raise OrientdError(f"many plans at once need {module}: pip install '{package}'")


@contextlib.contextmanager
def _cluster(backend: str, address: str | None) -> Iterator[None]:
    """Connect to a cluster, if the backend is one."""
    if backend == "loky":
        if address is not None:
            raise OrientdError(f"a cluster's address needs the backend ray or dask, got {address}")
        yield
        return
    entered: Any
    try:
        host, _, port = (address or "").rpartition("://")[2].rpartition(":")
        if port.isdecimal():
            # Ray itself would wait for minutes for a missing cluster.
            socket.create_connection((host, int(port)), timeout=_PATIENCE).close()
        if backend == "ray":
            import ray
            from ray.util.joblib import register_ray

            register_ray()
            entered = ray.init(address=address, include_dashboard=False, logging_level="error")
        else:
            from distributed import Client

            entered = Client(address)
    except (OSError, ConnectionError, RuntimeError, ValueError) as error:
        where = "on this machine" if address is None else f"at {address}"
        raise OrientdError(f"no {backend} cluster {where}: {error}") from error
    with entered:
        yield
