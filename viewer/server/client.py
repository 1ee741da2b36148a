"""Client: one WebSocket, from its login to its end.

Two tasks serve it: one reads its messages, one sends frames at the frame rate. A client that reads
slowly delays only its own tasks.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING, Any

from aiohttp import WSCloseCode, WSMsgType, web

from msg_bridge.contract.errors import EarthmovingError
from teleop.key_layout import ACTION_KEYS, CONTROLS, KEYS
from viewer.server.backend import Source
from viewer.server.frames import FrameStream
from viewer.server.packing import pack
from viewer.server.page_messages import (
    PROTOCOL,
    Ack,
    EmergencyStop,
    ListBags,
    Login,
    PageMessage,
    Ping,
    Playback,
    ReleaseControl,
    RequestRejectedError,
    parse_page_message,
)
from viewer.server.rate_limit import RateLimit

if TYPE_CHECKING:
    from viewer.server.hub import Hub

__all__ = ["Client"]

_LOGIN_TIME = 10.0
"""Wall time for the login [s]."""

_REJECTION_DELAY = 0.5
"""Wall time before a rejected login is answered [s], against guessing."""

_MESSAGE_RATE, _MESSAGE_BURST = 250.0, 500.0
"""Messages a second, and at once: a driver sends 20 to 60, and one acknowledges each frame."""

_UNLIMITED = (EmergencyStop, ReleaseControl, Ack)
"""Messages that are carried out at any rate: what stops a machine, and what frees the stream."""

_MAX_REJECTED = 1000
"""Rejected messages at once, and per minute, above which a client is disconnected."""

_ERROR_RATE = 10.0
"""Maximum number of errors sent a second; the others are only counted."""

_TIMELINE_PERIOD = 0.2
"""Wall time between two messages `timeline` [s]."""


class Client:
    """One connection.

    Attributes:
        number: number of the client, from 1.
    """

    def __init__(self, hub: Hub, socket: web.WebSocketResponse, number: int) -> None:
        """
        Args:
            hub: all connections.
            socket: the connection.
            number: number of the client.
        """
        self.number = number
        self._hub, self._socket = hub, socket
        self._limit = RateLimit(_MESSAGE_RATE, _MESSAGE_BURST)
        self._error_limit = RateLimit(_ERROR_RATE, _ERROR_RATE)
        self._rejection_limit = RateLimit(_MAX_REJECTED / 60.0, _MAX_REJECTED)
        self._control_version = -1
        self._recording: Any = None
        self._timeline: Any = None
        self._timeline_time = 0.0
        self._reported_failure = ""
        self._frames: FrameStream | None = None

    @property
    def latency(self) -> float:
        """Time from sending a frame to its acknowledgement [s]."""
        return 0.0 if self._frames is None else self._frames.latency

    async def run(self) -> None:
        """Serve the client until it ends."""
        source = await self._login()
        if source is None:
            return
        self._frames = FrameStream(source.encoder)
        sender = asyncio.create_task(self._send_frames_until_failure(source, self._frames))
        try:
            await self._read(source)
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sender
            self._hub.discard(self)
            if source.player is not None:
                source.player.close()

    async def send_error(self, code: str, reason: str) -> None:
        """Send the message `error`."""
        await self._send({"type": "error", "code": code, "message": reason})

    async def _login(self) -> Source | None:
        """Return the source that the client has asked for; None if it is rejected."""
        try:
            received = await self._socket.receive(timeout=_LOGIN_TIME)
        except asyncio.TimeoutError:
            await self._reject("login_timeout", f"no login within {_LOGIN_TIME:g} s")
            return None
        if received.type is not WSMsgType.TEXT:
            if received.type is WSMsgType.BINARY:
                await self._reject("not_json", "messages of the page are JSON texts")
            return None
        try:
            message = parse_page_message(received.data)
            if not isinstance(message, Login):
                raise RequestRejectedError("login_required", "the first message must be login")
            if not self._hub.access.is_token_valid(message.token):
                if not message.token:
                    raise RequestRejectedError(
                        "token_required",
                        "this server requires a token; open the address that it printed",
                    )
                raise RequestRejectedError(
                    "wrong_token", "the token is wrong; open the address that the server printed"
                )
            if message.protocol != PROTOCOL:
                raise RequestRejectedError(
                    "wrong_protocol",
                    f"the server has protocol {PROTOCOL}, the page {message.protocol}; reload it",
                )
            self._hub.add(self)
            source = await self._hub.open(message.bag)
        except RequestRejectedError as error:
            await self._reject(error.code, str(error))
            return None
        except EarthmovingError as error:
            await self._reject("no_source", str(error))
            return None
        await self._send(self._hello(source))
        if source.player is None and self._hub.library is not None:
            await self._send_bags()
        return source

    async def _reject(self, code: str, reason: str) -> None:
        self._hub.count_rejection(code, reason)
        await asyncio.sleep(_REJECTION_DELAY)
        await self.send_error(code, reason)
        await self._socket.close(code=WSCloseCode.POLICY_VIOLATION)

    def _hello(self, source: Source) -> dict[str, Any]:
        permissions, is_live = self._hub.permissions, source.player is None
        return {
            "type": "hello",
            "protocol": PROTOCOL,
            "server": self._hub.server_name,
            "source": "live" if is_live else "bag",
            "title": source.title,
            "client": str(self.number),
            "may_drive": is_live and permissions.driving,
            "may_control_simulation": is_live and permissions.simulation_control,
            "may_record": is_live and permissions.recording,
            "keys": KEYS,
            "action_keys": ACTION_KEYS,
            "controls": list(CONTROLS),
            "frame_rate": self._hub.frame_rate,
        }

    async def _read(self, source: Source) -> None:
        """Process messages until the connection ends."""
        async for received in self._socket:
            if received.type is WSMsgType.ERROR:
                self._hub.count_rejection("connection", str(self._socket.exception()))
                return
            try:
                if received.type is not WSMsgType.TEXT:
                    raise RequestRejectedError("not_json", "messages of the page are JSON texts")
                message = parse_page_message(received.data)
                if not isinstance(message, _UNLIMITED) and not self._limit.allow():
                    raise RequestRejectedError(
                        "too_many", f"send at most {_MESSAGE_RATE:g} messages a second"
                    )
                await self._process(message, source)
            except RequestRejectedError as error:
                self._hub.count_rejection(error.code, str(error))
                if not self._rejection_limit.allow():
                    await self._socket.close(code=WSCloseCode.POLICY_VIOLATION)
                    return
                if self._error_limit.allow():
                    await self.send_error(error.code, str(error))

    async def _process(self, message: PageMessage, source: Source) -> None:
        """Carry a message out.

        Raises:
            RequestRejectedError: it is not allowed, or not now.
        """
        assert self._frames is not None
        if isinstance(message, Ack):
            if not self._frames.acknowledge(message.seq):
                raise RequestRejectedError("unknown_frame", f"frame {message.seq} waits for no ack")
        elif isinstance(message, Ping):
            await self._send({"type": "pong", "id": message.id})
        elif isinstance(message, ListBags):
            await self._send_bags()
        elif isinstance(message, Playback):
            _control_playback(message, source)
            self._timeline = None
        elif isinstance(message, Login):
            raise RequestRejectedError("logged_in", "this client has logged in already")
        elif source.player is not None:
            raise RequestRejectedError("bag", "a bag is shown; there is nothing to control in it")
        else:
            self._hub.process(self, message)

    async def _send_bags(self) -> None:
        """Send the names of the bags; their folder is read in another thread."""
        library = self._hub.library
        names = [] if library is None else await asyncio.to_thread(library.names)
        await self._send({"type": "bags", "names": names})

    async def _send_frames_until_failure(self, source: Source, frames: FrameStream) -> None:
        """Send frames; after a failure close the connection, so that the page shows its end."""
        try:
            await self._send_frames(source, frames)
        except ConnectionError:  # the client has gone
            pass
        except Exception as error:
            self._hub.report_failure("frames", error)
            await self._socket.close(code=WSCloseCode.INTERNAL_ERROR)

    async def _send_frames(self, source: Source, frames: FrameStream) -> None:
        """Send what has changed, at the frame rate."""
        loop = asyncio.get_running_loop()
        period = 1.0 / self._hub.frame_rate
        due = loop.time()
        while not self._socket.closed:
            await self._send_states(source)
            for message in frames.next_messages():
                await self._socket.send_bytes(message)
            due = max(due + period, loop.time())
            await asyncio.sleep(due - loop.time())

    async def _send_states(self, source: Source) -> None:
        """Send the small messages that are due: drivers, recording, position in the bag."""
        if source.player is None:
            if self._control_version != self._hub.driving.version:
                self._control_version = self._hub.driving.version
                drivers = {
                    machine: {"id": str(client), "is_you": client == self.number}
                    for machine, client in self._hub.driving.drivers.items()
                }
                await self._send({"type": "control", "drivers": drivers})
            recording = self._hub.recording()
            if recording is not None and recording != self._recording:
                self._recording = recording
                await self._send(
                    {
                        "type": "recording",
                        "on": recording.on,
                        "path": recording.path,
                        "bytes": recording.num_bytes,
                        "failure": recording.failure,
                    }
                )
            return
        now = asyncio.get_running_loop().time()
        if self._timeline is None or now - self._timeline_time >= _TIMELINE_PERIOD:
            timeline = source.player.timeline()
            if timeline != self._timeline:
                self._timeline = timeline
                await self._send({"type": "timeline", **timeline._asdict()})
            self._timeline_time = now
            failure = source.player.failure()
            if failure and failure != self._reported_failure:
                self._reported_failure = failure
                await self.send_error("bag", failure)

    async def _send(self, message: dict[str, Any]) -> None:
        if not self._socket.closed:
            with contextlib.suppress(ConnectionError):
                await self._socket.send_bytes(pack(message))


def _control_playback(message: Playback, source: Source) -> None:
    """Control the player of a bag.

    Raises:
        RequestRejectedError: a live simulation is shown.
    """
    player = source.player
    if player is None:
        raise RequestRejectedError("live", "a live simulation is shown; it has no playback")
    if message.action == "play":
        player.play()
    elif message.action == "pause":
        player.pause()
    elif message.action == "seek":
        player.seek(message.value)
    else:
        player.set_rate(message.value)
