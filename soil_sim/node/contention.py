"""Machines as which another session requests to join, at present."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["CONTENTION_TIMEOUT", "Contention"]

CONTENTION_TIMEOUT = 1.0
"""Wall time after which a request to join that was not repeated has no effect any more [s].

A machine node repeats its request every 0.25 s."""


class Contention:
    """When the last request to join arrived as a machine that takes part in another session.

    Independent of the clock: the caller passes the time.
    """

    def __init__(self) -> None:
        self._num_requests: dict[int, int] = {}  # by machine id, at the last update
        self._request_times: dict[int, float] = {}  # by machine id [s]

    def update(self, now: float, num_requests: Mapping[int, int]) -> None:
        """Record which requests have arrived since the last update.

        Args:
            now: monotonic wall clock [s].
            num_requests: number of requests since the present session of the machine began, by
                machine id; see `SoilExchange.contending_requests`.
        """
        for machine_id, number in num_requests.items():
            if number != self._num_requests.get(machine_id, 0):
                self._request_times[machine_id] = now
        self._num_requests = dict(num_requests)
        self._request_times = {n: t for n, t in self._request_times.items() if n in num_requests}

    def is_contended(self, machine_id: int, now: float) -> bool:
        """Return whether a request to join as a machine arrived in the last second."""
        request_time = self._request_times.get(machine_id)
        return request_time is not None and now - request_time < CONTENTION_TIMEOUT
