"""ThrottledRelay: a TCP relay that passes a limited number of bytes a second, as a slow link."""

from __future__ import annotations

import asyncio
import contextlib
import threading

__all__ = ["ThrottledRelay"]

_CHUNK = 1024
_BUFFER = 4096
"""Bytes that the relay holds in each direction."""


class ThrottledRelay:
    """Relays connections to a local port.

    Attributes:
        port: port of the relay.
        bytes_per_second: rate from the server to each client; may be changed at any time.
    """

    def __init__(self, server_port: int, bytes_per_second: float = 1e9) -> None:
        self.bytes_per_second = bytes_per_second
        self._server_port = server_port
        # A thread of its own: playwright runs a loop in that of the test.
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        start = asyncio.start_server(self._relay, "127.0.0.1", 0)
        server = asyncio.run_coroutine_threadsafe(start, self._loop).result()
        self.port: int = server.sockets[0].getsockname()[1]

    def close(self) -> None:
        """End all connections."""
        asyncio.run_coroutine_threadsafe(self._cancel_tasks(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _cancel_tasks(self) -> None:
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _relay(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        server_reader, server_writer = await asyncio.open_connection(
            "127.0.0.1", self._server_port, limit=_BUFFER
        )
        writer.transport.set_write_buffer_limits(high=_BUFFER)
        with contextlib.suppress(OSError):
            await asyncio.gather(
                self._pass_on(server_reader, writer, is_limited=True),
                self._pass_on(reader, server_writer, is_limited=False),
            )
        writer.close()
        server_writer.close()

    async def _pass_on(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, is_limited: bool
    ) -> None:
        while data := await reader.read(_CHUNK if is_limited else 65536):
            writer.write(data)
            await writer.drain()
            if is_limited and self.bytes_per_second < 1e9:
                await asyncio.sleep(len(data) / self.bytes_per_second)
        writer.close()
