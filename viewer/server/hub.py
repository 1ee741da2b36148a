"""Hub: all clients of a server, and what they share: the drivers, the permissions, the counters."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import Counter
from collections.abc import Callable, Mapping

from msg_bridge.contract.printable import printable
from viewer.server.access import AccessPolicy
from viewer.server.backend import BagLibrary, LiveBackend, Permissions, Recording, Source
from viewer.server.client import Client
from viewer.server.driving import LEVER_PERIOD, Driving
from viewer.server.page_messages import (
    Drive,
    EmergencyStop,
    PageMessage,
    Record,
    ReleaseControl,
    RequestRejectedError,
    SimulationAction,
    Speed,
    TakeControl,
)
from viewer.server.rate_limit import RateLimit

__all__ = ["MAX_LOGINS", "Hub", "Statistics"]

MAX_LOGINS = 16
"""Maximum number of connections that have not logged in; each has 10 s."""

_LOG_RATE = 1.0
"""Maximum number of failures of the server that are logged a second; the others are counted."""

_LOGGER = logging.getLogger(__name__)


class Statistics:
    """Counters of the server, read by another thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rejections: Counter[str] = Counter()
        self._last_rejection = ""
        self._clients: dict[int, float] = {}
        self.drivers: dict[str, int] = {}

    def count_rejection(self, code: str, reason: str) -> None:
        """Count something rejected."""
        with self._lock:
            self._rejections[code] += 1
            self._last_rejection = printable(f"{code}: {reason}")

    def set_clients(self, latencies: dict[int, float]) -> None:
        """Set the latency of each client [s]."""
        with self._lock:
            self._clients = latencies

    def rejections(self) -> tuple[dict[str, int], str]:
        """Return the number of rejections by code, and the last reason."""
        with self._lock:
            return dict(self._rejections), self._last_rejection

    def clients(self) -> dict[int, float]:
        """Return the latency of each client [s] by its number."""
        with self._lock:
            return dict(self._clients)


class Hub:
    """All connections of a server.

    Everything but `statistics` is used by the thread of the server only.

    Attributes:
        access: rules of access.
        permissions: what clients may do.
        library: the bags that clients may open; None without.
        server_name: name and version for the page.
        frame_rate: maximum number of frames a second.
        max_clients: maximum number of clients that have logged in.
        driving: the drivers.
        statistics: counters.
    """

    def __init__(
        self,
        access: AccessPolicy,
        *,
        server_name: str,
        frame_rate: float,
        max_clients: int,
        permissions: Permissions = Permissions(),  # noqa: B008 - frozen
        live: Source | None = None,
        backend: LiveBackend | None = None,
        library: BagLibrary | None = None,
        default_bag: str = "",
    ) -> None:
        """
        Args:
            access, server_name, frame_rate, max_clients, permissions, library: attributes.
            live: the live simulation; None if only bags are shown.
            backend: requests to the live simulation.
            default_bag: bag that a client without a wish is shown if there is no live simulation.
        """
        self.access, self.permissions = access, permissions
        self.server_name, self.frame_rate = server_name, frame_rate
        self.max_clients, self.library = max_clients, library
        self.statistics = Statistics()
        self._live, self._backend, self._default_bag = live, backend, default_bag
        self._clients: dict[int, Client] = {}
        self._logins: set[int] = set()
        self._last_number = 0
        self._log_limit = RateLimit(_LOG_RATE, 1.0)
        self.driving = Driving(self._publish_levers)

    def new_number(self) -> int:
        """Return a number for the next client."""
        self._last_number += 1
        return self._last_number

    @property
    def is_full(self) -> bool:
        """Whether there are as many clients as allowed."""
        return len(self._clients) >= self.max_clients

    def add_login(self, client: Client) -> None:
        """Add a connection that has not logged in.

        Raises:
            RequestRejectedError: there are too many of them, or too many clients.
        """
        self._require_place()
        if len(self._logins) >= MAX_LOGINS:
            raise RequestRejectedError(
                "too_many_logins", f"{MAX_LOGINS} connections have not logged in; try again"
            )
        self._logins.add(client.number)

    def add(self, client: Client) -> None:
        """Add a client that has logged in.

        Raises:
            RequestRejectedError: there are too many clients.
        """
        self._require_place()
        self._logins.discard(client.number)
        self._clients[client.number] = client

    def discard(self, client: Client) -> None:
        """Remove a connection; its levers are released."""
        self._logins.discard(client.number)
        self._clients.pop(client.number, None)
        self.driving.discard(client.number)
        self.update_statistics()

    def count_rejection(self, code: str, reason: str) -> None:
        """Count something rejected, for the diagnostics."""
        self.statistics.count_rejection(code, reason)

    def report_failure(self, code: str, error: Exception) -> None:
        """Count a failure of the server itself, and log where it came from, not too often."""
        self.count_rejection(code, f"{type(error).__name__}: {error}")
        if self._log_limit.allow():
            _LOGGER.error("the web server has failed (%s)", code, exc_info=error)

    async def open(self, bag: str | None) -> Source:
        """Return the source for a client: the live simulation, or a bag.

        Raises:
            EarthmovingError: there is no such bag, or it cannot be read.
        """
        if bag is None:
            if self._live is not None:
                return self._live
            bag = self._default_bag
        if self.library is None:
            raise RequestRejectedError("no_bags", "this server offers no bags; set bag_folder")
        return await asyncio.to_thread(self.library.open, bag)

    def recording(self) -> Recording | None:
        """Return the present recording; None if clients may not record."""
        if self._backend is None or not self.permissions.recording:
            return None
        return self._backend.recording()

    def process(self, client: Client, message: PageMessage) -> None:
        """Carry out a message that controls the live simulation.

        Raises:
            RequestRejectedError: it is not allowed, or not now.
        """
        if isinstance(message, (TakeControl, ReleaseControl, Drive, Speed, EmergencyStop)):
            # Everyone may stop a machine, also where driving is not allowed.
            stops = isinstance(message, EmergencyStop) and message.pressed
            self._require(stops or self.permissions.driving, "driving", "allow_driving")
            self._process_driving(client, message)
        elif isinstance(message, SimulationAction):
            allowed = self.permissions.simulation_control
            self._require(allowed, "control of the simulation", "allow_simulation_control")
            assert self._backend is not None
            self._backend.control_simulation(message.action, self._reply_to(client, "simulation"))
        elif isinstance(message, Record):
            self._require(self.permissions.recording, "recording", "allow_recording")
            assert self._backend is not None
            self._backend.record(message.on, self._reply_to(client, "record"))

    async def run(self) -> None:
        """Move the levers, until cancelled."""
        while True:
            self.update()
            await asyncio.sleep(LEVER_PERIOD)

    def update(self) -> None:
        """Move the levers; release those of machines that are stopped or gone."""
        self._attempt(self._stop_levers)
        self._attempt(self.driving.update)
        self._attempt(self._release_absent_machines)
        self._attempt(self.update_statistics)

    def close(self) -> None:
        """Release all levers."""
        for client in list(self._clients.values()):
            self.driving.discard(client.number)

    def update_statistics(self) -> None:
        """Set what the diagnostics show of the clients."""
        self.statistics.set_clients({n: each.latency for n, each in self._clients.items()})
        self.statistics.drivers = self.driving.drivers

    def _process_driving(
        self,
        client: Client,
        message: TakeControl | ReleaseControl | Drive | Speed | EmergencyStop,
    ) -> None:
        number = client.number
        if isinstance(message, TakeControl):
            self._require_machine(message.machine)
            self.driving.take(number, message.machine, force=message.force)
        elif isinstance(message, ReleaseControl):
            self.driving.release(number)
        elif isinstance(message, Speed):
            self.driving.set_speed(number, message.value)
        elif isinstance(message, Drive):
            self.driving.drive(number, message, is_stopped=self._is_stopped(message.machine))
        else:
            self._set_emergency_stop(number, message)

    def _set_emergency_stop(self, client: int, message: EmergencyStop) -> None:
        self._require_machine(message.machine)
        driver = self.driving.drivers.get(message.machine)
        if not message.pressed and driver not in (None, client):
            raise RequestRejectedError(
                "not_driving",
                f"only viewer {driver}, the driver of {message.machine}, releases its stop",
            )
        if message.pressed:
            self.driving.stop(message.machine)
        assert self._backend is not None
        self._backend.set_emergency_stop(message.machine, message.pressed)

    def _publish_levers(self, machine: str, deflections: Mapping[str, float]) -> None:
        assert self._backend is not None
        self._backend.publish_levers(machine, deflections)

    def _is_stopped(self, machine: str) -> bool:
        assert self._live is not None
        view = self._live.encoder.scene.machines.get(machine)
        return view is not None and (view.is_stopped is True or view.is_stop_requested)

    def _attempt(self, step: Callable[[], None]) -> None:
        """Call a step of the update; after any failure silent drivers must still be released."""
        try:
            step()
        except Exception as error:
            self.report_failure("levers", error)

    def _stop_levers(self) -> None:
        """Release the levers of stopped machines, whoever has pressed the stop."""
        for machine in self.driving.drivers:
            if self._is_stopped(machine):
                self.driving.stop(machine)

    def _release_absent_machines(self) -> None:
        if self._live is None:
            return
        machines = self._live.encoder.scene.machines
        for machine in self.driving.drivers:
            if machine not in machines:
                self.driving.release_machine(machine)

    def _require_place(self) -> None:
        """Reject a client beyond the maximum."""
        if self.is_full:
            raise RequestRejectedError(
                "full", f"the server has {self.max_clients} clients; set max_clients"
            )

    def _require_machine(self, machine: str) -> None:
        """Reject a machine that does not exist."""
        assert self._live is not None
        if machine not in self._live.encoder.scene.machines:
            raise RequestRejectedError("no_machine", f"there is no machine {machine[:100]!r}")

    def _require(self, is_allowed: bool, what: str, parameter: str) -> None:
        """Reject what a parameter does not allow, or what needs a simulation."""
        if self._backend is None or not is_allowed:
            raise RequestRejectedError("not_allowed", f"{what} is not allowed; set {parameter}")

    def _reply_to(self, client: Client, code: str) -> Callable[[str], None]:
        """Return a function that sends an error to a client, callable in any thread."""
        loop = asyncio.get_running_loop()

        def reply(reason: str) -> None:
            self.count_rejection(code, reason)
            if not loop.is_closed():
                asyncio.run_coroutine_threadsafe(client.send_error(code, reason), loop)

        return reply
