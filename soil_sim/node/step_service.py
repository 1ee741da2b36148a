"""StepService: single steps, whose responses wait for their tick.

A coroutine that waits for its tick would be resumed by the executor again and again: 200 of them
cost more than the ticks. So a request is kept with its header, and answered later.

A client has the default QoS, so its middleware keeps only the last 10 responses that it has not
taken yet, and a client takes none while it sends requests. So after a few responses, those to a
burst of requests wait until no more requests arrive, and are then sent no faster than any client
takes them. A client that waits for each response before its next request is not delayed.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from rclpy.node import Node
from std_srvs.srv import Trigger

from msg_bridge.codec import qos
from msg_bridge.contract import topics
from soil_sim.errors import SoilError

__all__ = ["StepService"]

_MAX_AT_ONCE = 6
"""Number of responses that are sent at once."""

_FREE_PERIOD = 0.002
"""Wall time per response up to which responses are not delayed [s]."""

_BURST_PERIOD = 0.006
"""Wall time between responses to a burst [s]: a client may stall for ten of them."""

_QUIET_TIME = 0.025
"""Wall time without a request after which a client has sent its burst [s]."""

_MAX_DELAY = 0.25
"""Maximum wall time between responses while requests keep arriving [s]."""


class _PendingStep(NamedTuple):
    """A step whose response has not been sent.

    Attributes:
        tick: tick that completes it.
        response: response once the tick is completed.
        header: header of the request.
    """

    tick: int
    response: Trigger.Response
    header: Any


class StepService:
    """Server of single steps."""

    def __init__(
        self,
        node: Node,
        request_step: Callable[[], int],
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            node: the soil node.
            request_step: requests one more tick and returns its number; raises `SoilError` with
                the reason if there can be none now.
            now: a monotonic wall clock [s].
        """
        self._request_step, self._now = request_step, now
        self._steps: deque[_PendingStep] = deque()  # ascending by tick
        self._requested: int | None = None  # tick of the request that is being processed
        self._last_tick = -1
        self._sent: deque[float] = deque(maxlen=_MAX_AT_ONCE)  # times of the last responses
        self._last_request = -math.inf
        self._is_burst = False
        service = node.create_service(
            Trigger, topics.STEP_SERVICE, self._on_request, qos_profile=qos.SERVICES
        )
        self._send = service.send_response
        # The executor passes each response with the header of its request.
        service.send_response = self._on_response
        self._timer = node.create_timer(_FREE_PERIOD, self._respond)
        self._timer.cancel()

    @property
    def num_pending(self) -> int:
        """Number of steps without a response."""
        return len(self._steps)

    def on_tick(self, tick: int) -> None:
        """Respond to the steps that a completed tick fulfils."""
        self._last_tick = tick
        if self._steps:
            self._respond()

    def cancel(self) -> None:
        """End all steps that wait for a tick: the run is reset."""
        for step in self._steps:
            if step.tick > self._last_tick:
                step.response.success, step.response.message = False, "the run was reset"
            self._send(step.response, step.header)
        self._steps.clear()
        self._last_tick = -1

    def _on_request(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._last_request = self._now()
        try:
            self._requested = self._request_step()
            response.success, response.message = True, f"tick {self._requested} completed"
        except SoilError as error:
            self._requested = None
            response.success, response.message = False, str(error)
        return response

    def _on_response(self, response: Trigger.Response, header: Any) -> None:
        if self._requested is None:
            self._send(response, header)
            return
        self._steps.append(_PendingStep(self._requested, response, header))
        self._respond()

    def _respond(self) -> None:
        """Send the responses that are due; the timer runs while others wait for their turn."""
        while self._steps and self._steps[0].tick <= self._last_tick:
            now = self._now()
            if not self._may_respond(now):
                if self._timer.is_canceled():
                    self._timer.reset()
                return
            self._sent.append(now)
            step = self._steps.popleft()
            self._send(step.response, step.header)
        self._is_burst = False
        self._timer.cancel()

    def _may_respond(self, now: float) -> bool:
        if self._is_burst:
            since = now - self._sent[-1]
            is_quiet = now - self._last_request >= _QUIET_TIME
            return since >= (_BURST_PERIOD if is_quiet else _MAX_DELAY)
        is_full = len(self._sent) == _MAX_AT_ONCE
        self._is_burst = is_full and now - self._sent[0] < _MAX_AT_ONCE * _FREE_PERIOD
        return not self._is_burst
