"""The client's side of the lease: take it when it is first needed, renew it, give it back."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable

from orientd.errors import LeaseError, OrientdError
from orientd.rpc import control_pb2 as pb

RENEWALS = 3
"""Renewals within the time that a lease lasts."""


class LeaseKeeper:
    """Hold the lease for as long as it is needed."""

    def __init__(
        self,
        *,
        acquire: Callable[[], pb.Lease],
        renew: Callable[[str], object],
        release: Callable[[str], object],
        devices: Iterable[str] = (),
    ) -> None:
        """Hold nothing yet.

        Args:
            acquire: asks the daemon for the lease.
            renew: renews the one of a token.
            release: gives the one of a token back.
            devices: that it will be of; empty for all there are.
        """
        self._devices = tuple(devices)
        self._acquire = acquire
        self._renew = renew
        self._release = release
        self._lock = threading.Lock()
        self._token = ""
        self._lost: OrientdError | None = None
        self._done = threading.Event()

    @property
    def is_held(self) -> bool:
        """Whether the lease is held."""
        return bool(self._token)

    def covers(self, device: str) -> bool:
        """Whether the lease is, or will be, of *device*."""
        return not self._devices or device in self._devices

    def token(self) -> str:
        """Return the token of the lease, which is taken if it is not held yet.

        Raises:
            LeaseError: somebody else holds it, or it was lost since it was last used; then the
                next call asks for it again.
            DaemonError: the daemon does not answer.
        """
        with self._lock:
            if self._lost is not None:
                lost, self._lost = self._lost, None
                raise LeaseError(f"the lease was lost: {lost}") from lost
            if not self._token:
                self._hold(self._acquire())
            return self._token

    def hold(self, lease: pb.Lease) -> None:
        """Keep *lease*, which somebody has asked for, from now on."""
        with self._lock:
            self._done.set()
            self._lost = None
            self._hold(lease)

    def _hold(self, lease: pb.Lease) -> None:
        self._token = lease.token
        # Whoever names no device, of one there is, has the lease of that.
        self._devices = tuple(lease.devices) + tuple(name for name in self._devices if not name)
        self._done = threading.Event()
        threading.Thread(
            target=self._keep,
            args=(lease.token, lease.seconds / RENEWALS, self._done),
            name="orientd lease",
            daemon=True,
        ).start()

    def release(self) -> None:
        """Give the lease back, if it is held; it does not matter whether the daemon still knows."""
        with self._lock:
            token, self._token = self._token, ""
            self._done.set()
            self._lost = None
        if token:
            with contextlib.suppress(OrientdError):
                self._release(token)

    def _keep(self, token: str, interval: float, done: threading.Event) -> None:
        failures = 0
        while not done.wait(interval):
            try:
                self._renew(token)
            except OrientdError as error:
                failures += 1
                # A daemon that is only slow may still answer in time.
                if isinstance(error, LeaseError) or failures == RENEWALS:
                    with self._lock:
                        if self._token == token:
                            self._token, self._lost = "", error
                    return
            else:
                failures = 0
