"""A client of the Foxglove WebSocket protocol (subprotocol foxglove.sdk.v1)."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from collections.abc import Coroutine
from typing import Any

import aiohttp

__all__ = ["FoxgloveClient"]

_MESSAGE, _TIME, _SERVICE_RESPONSE = 1, 2, 3
"""First byte of binary messages of the server."""


class FoxgloveClient:
    """A connection in a thread of its own.

    Attributes:
        infos: JSON messages of the server that are not listed below, in their order.
        channels: advertised channels by topic.
        services: advertised services by name.
        messages: received messages by topic, as (log time [ns], data).
        times: received times [ns].
        responses: serialised responses of services by call id.
    """

    def __init__(self, port: int) -> None:
        self.infos: list[dict[str, Any]] = []
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = {}
        self.times: list[int] = []
        self.responses: dict[int, bytes] = {}
        self._topics: dict[int, str] = {}  # by subscription id
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._loop = asyncio.new_event_loop()
        self._connected = threading.Event()
        self._thread = threading.Thread(
            target=self._loop.run_until_complete, args=(self._run(port),), daemon=True
        )
        self._thread.start()
        assert self._connected.wait(10.0), "no connection"

    def close(self) -> None:
        """Disconnect."""
        if self._thread.is_alive() and self._socket is not None:
            self._call(self._socket.close())
        self._thread.join(10.0)

    def subscribe(self, *topics: str) -> None:
        """Subscribe to advertised topics."""
        new = {len(self._topics) + i: topic for i, topic in enumerate(topics)}
        self._topics.update(new)
        entries = [{"id": i, "channelId": self.channels[each]["id"]} for i, each in new.items()]
        self._send_json({"op": "subscribe", "subscriptions": entries})

    def advertise(self, channel: int, topic: str, type_name: str, encoding: str = "cdr") -> None:
        """Advertise a topic to publish on."""
        entry = {"id": channel, "topic": topic, "encoding": encoding, "schemaName": type_name}
        self._send_json({"op": "advertise", "channels": [entry]})

    def publish(self, channel: int, data: bytes) -> None:
        """Publish a serialised message."""
        self._send_bytes(struct.pack("<BI", 1, channel) + data)

    def call(self, service: str, call_id: int, data: bytes) -> None:
        """Call a service."""
        header = struct.pack("<BIII", 2, self.services[service]["id"], call_id, 3)
        self._send_bytes(header + b"cdr" + data)

    def _send_json(self, message: dict[str, Any]) -> None:
        assert self._socket is not None
        self._call(self._socket.send_str(json.dumps(message)))

    def _send_bytes(self, data: bytes) -> None:
        assert self._socket is not None
        self._call(self._socket.send_bytes(data))

    def _call(self, coroutine: Coroutine[Any, Any, Any]) -> None:
        asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(10.0)

    async def _run(self, port: int) -> None:
        address = f"ws://127.0.0.1:{port}"
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(address, protocols=["foxglove.sdk.v1"], max_msg_size=0) as socket,
        ):
            self._socket = socket
            self._connected.set()
            async for message in socket:
                if message.type is aiohttp.WSMsgType.TEXT:
                    self._receive_json(json.loads(message.data))
                elif message.type is aiohttp.WSMsgType.BINARY:
                    self._receive_bytes(message.data)

    def _receive_json(self, message: dict[str, Any]) -> None:
        if message["op"] == "advertise":
            self.channels.update((each["topic"], each) for each in message["channels"])
        elif message["op"] == "advertiseServices":
            self.services.update((each["name"], each) for each in message["services"])
        else:
            self.infos.append(message)

    def _receive_bytes(self, data: bytes) -> None:
        if data[0] == _MESSAGE:
            subscription, time = struct.unpack_from("<IQ", data, 1)
            received = self.messages.setdefault(self._topics[subscription], [])
            received.append((time, data[13:]))
        elif data[0] == _TIME:
            self.times.append(struct.unpack_from("<Q", data, 1)[0])
        elif data[0] == _SERVICE_RESPONSE:
            _, call_id, size = struct.unpack_from("<III", data, 1)
            self.responses[call_id] = data[13 + size :]
