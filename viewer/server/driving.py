"""The driver of each machine, and the levers of each driver.

One client drives a machine at a time. Its levers move by the keys that it holds, and are released
when it has been silent for the dead-man time, gives the control away or disconnects.

After an emergency stop its messages count again once one of them holds no lever: a key that is held
through the stop does not start the machine. Messages that arrive late move nothing:
they are what the driver held some time ago. The machine has the same interlock, but for it the
levers that are published as released for a stopped driver are released.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from teleop.key_layout import CONTROLS
from teleop.levers import Levers
from viewer.server.message_delay import MAX_DELAY, MessageDelay
from viewer.server.page_messages import Drive, RequestRejectedError

__all__ = ["DEAD_MAN_TIME", "LEVER_PERIOD", "Driving", "PublishLevers"]

DEAD_MAN_TIME = 0.3
"""Wall time without a message of the driver after which the levers are released [s]."""

LEVER_PERIOD = 0.02
"""Wall time between two updates of the levers [s]."""

PublishLevers = Callable[[str, Mapping[str, float]], None]
"""Publishes the deflections of the controls of a machine."""

_MAX_INTERVAL = 0.1

_SHORT_DELAY = 1.0
"""Wall time with late messages only after which they are rejected, and not dropped silently [s]:
a busy computer delays some for a moment."""


@dataclass
class _Session:
    """One driver at one machine."""

    client: int
    machine: str
    levers: Levers = field(default_factory=Levers)
    held: tuple[str, ...] = ()
    deflections: dict[str, float] = field(default_factory=dict)
    last_message: float = -float("inf")
    last_update: float = -float("inf")
    is_active: bool = False  # whether something was published since the last release
    must_return_to_rest: bool = False  # after an emergency stop, until the driver holds no lever


class Driving:
    """The drivers of all machines.

    Attributes:
        version: increases with each change of a driver.
    """

    def __init__(self, publish: PublishLevers, now: Callable[[], float] = time.monotonic) -> None:
        """
        Args:
            publish: publishes deflections.
            now: a monotonic wall clock [s].
        """
        self.version = 0
        self._publish, self._now = publish, now
        self._sessions: dict[str, _Session] = {}  # by machine
        self._speeds: dict[int, float] = {}  # by client
        self._delays: dict[int, MessageDelay] = {}  # by client

    @property
    def drivers(self) -> dict[str, int]:
        """Client by machine."""
        return {machine: session.client for machine, session in self._sessions.items()}

    def take(self, client: int, machine: str, *, force: bool = False) -> None:
        """Make a client the driver of a machine; it gives away any other one.

        Raises:
            RequestRejectedError: another client drives it.
        """
        session = self._sessions.get(machine)
        if session is not None and session.client == client:
            return
        if session is not None and not force:
            raise RequestRejectedError(
                "machine_taken", f"viewer {session.client} drives {machine}; take it by force"
            )
        self.release(client)
        if session is not None:
            self._end(session)
        self._sessions[machine] = _Session(client, machine)
        self._sessions[machine].levers.speed = self._speeds.get(client, 1.0)
        self.version += 1

    def release(self, client: int) -> None:
        """Release the levers of a client."""
        for session in list(self._sessions.values()):
            if session.client == client:
                self._end(session)

    def discard(self, client: int) -> None:
        """Release the levers of a client that has gone."""
        self.release(client)
        self._speeds.pop(client, None)
        self._delays.pop(client, None)

    def release_machine(self, machine: str) -> None:
        """Release the levers of a machine, for example one that is gone."""
        session = self._sessions.get(machine)
        if session is not None:
            self._end(session)

    def drive(self, client: int, message: Drive, *, is_stopped: bool = False) -> None:
        """Move the levers at once, and until the next message.

        Args:
            client: number of the client.
            message: what it holds.
            is_stopped: whether the emergency stop of the machine is pressed: nothing moves.

        Raises:
            RequestRejectedError: the client does not drive that machine, or its messages are late.
        """
        session = self._sessions.get(message.machine)
        if session is None or session.client != client:
            raise RequestRejectedError("not_driving", f"take control of {message.machine} first")
        is_at_rest = not message.held and not any(message.deflections.values())
        is_late = self._is_late(client, message, is_at_rest)
        if is_stopped:
            self.stop(message.machine)
        elif is_at_rest and not is_late:
            session.must_return_to_rest = False
        if is_late and not is_at_rest:
            if self._now() - session.last_message < _SHORT_DELAY:
                return
            raise RequestRejectedError(
                "late", f"levers that arrived more than {MAX_DELAY:g} s late were ignored"
            )
        if session.must_return_to_rest:
            return
        session.held, session.deflections = message.held, message.deflections
        session.last_message = self._now()
        self._update(session)

    def set_speed(self, client: int, value: float) -> None:
        """Set the full deflection of a held key for a client, 0.1 to 1."""
        self._speeds[client] = value
        for session in self._sessions.values():
            if session.client == client:
                session.levers.speed = value

    def stop(self, machine: str) -> None:
        """Release the levers of a machine whose emergency stop is pressed; its driver stays.

        What the driver holds is ignored until, after the last call, a message holds no lever.
        """
        session = self._sessions.get(machine)
        if session is not None:
            session.must_return_to_rest = True
            session.held, session.deflections = (), {}
            self._return_levers(session)

    def update(self) -> None:
        """Move all levers; call it every `LEVER_PERIOD`."""
        for session in self._sessions.values():
            if not session.is_active:
                continue
            if self._now() - session.last_message > DEAD_MAN_TIME:
                self._return_levers(session)
            else:
                self._update(session)

    def _is_late(self, client: int, message: Drive, is_at_rest: bool) -> bool:
        """Return whether a message arrives late; never if it has no time."""
        if message.time is None:
            return False
        delay = self._delays.setdefault(client, MessageDelay())
        return delay.is_late(message.time, self._now(), is_at_rest=is_at_rest)

    def _update(self, session: _Session) -> None:
        now = self._now()
        # The first message moves the lever by one period, so that the machine answers at once.
        elapsed = now - session.last_update if session.is_active else LEVER_PERIOD
        session.levers.update(session.held, min(elapsed, _MAX_INTERVAL))
        session.last_update, session.is_active = now, True
        self._publish(
            session.machine,
            {
                name: min(max(value + session.deflections.get(name, 0.0), -1.0), 1.0)
                for name, value in session.levers.deflections.items()
            },
        )

    def _return_levers(self, session: _Session) -> None:
        """Release the levers, and publish it once."""
        session.levers.release()
        if session.is_active:
            session.is_active = False
            self._publish(session.machine, dict.fromkeys(CONTROLS, 0.0))

    def _end(self, session: _Session) -> None:
        self._return_levers(session)
        del self._sessions[session.machine]
        self.version += 1
