"""Services of the simulation that clients call."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.client import Client
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from msg_bridge.contract.interface import INTERFACE, EndpointKind

__all__ = ["ServiceCalls"]

_MAX_RESPONSE_TIME = 30.0
"""Maximum wall time that a client waits for a response [s]."""


class ServiceCalls:
    """Passes calls of clients on to the services in the node's namespace.

    The server calls handlers in its own threads; ROS is used in the thread of the executor only.
    """

    def __init__(self, node: Node, sdk: Any, run_in_executor: Callable[[Callable[[], None]], None]):
        """
        Args:
            node: node of the clients.
            sdk: the module `foxglove`.
            run_in_executor: calls a function soon in the thread of the node's executor.
        """
        self._sdk = sdk
        self._run_in_executor = run_in_executor
        self.services = [
            self._service(node, each.name, each.type)
            for each in INTERFACE
            if each.kind is EndpointKind.SERVICE
        ]

    def _service(self, node: Node, name: str, type_name: str) -> Any:
        package, _, short_name = type_name.partition("/srv/")
        of = getattr(importlib.import_module(f"{package}.srv"), short_name)
        client = node.create_client(of, name)
        request, response = (
            self._sdk.MessageSchema(
                encoding="cdr",
                schema=self._sdk.Schema(
                    name=f"{type_name}_{part}", encoding="ros2msg", data=text.encode()
                ),
            )
            for part, text in zip(
                ("Request", "Response"), _definition(package, short_name), strict=True
            )
        )
        return self._sdk.Service(
            node.resolve_service_name(name),
            schema=self._sdk.ServiceSchema(type_name, request=request, response=response),
            handler=partial(self._handle, client, of),
        )

    def _handle(self, client: Client, of: Any, call: Any) -> bytes:
        """Return the serialised response to a call; an exception is reported to the client."""
        response: Future[Any] = Future()
        # Clients send a request without fields in various ways.
        has_fields = bool(of.Request.get_fields_and_field_types())
        request = deserialize_message(call.payload, of.Request) if has_fields else of.Request()

        def send() -> None:
            if not client.service_is_ready():
                response.set_exception(RuntimeError(f"{call.service_name} is not available"))
                return
            sent = client.call_async(request)
            sent.add_done_callback(lambda done: response.set_result(done.result()))

        self._run_in_executor(send)
        serialized: bytes = serialize_message(response.result(timeout=_MAX_RESPONSE_TIME))
        return serialized


def _definition(package: str, name: str) -> tuple[str, str]:
    """Return the definitions of request and response of a service type."""
    module = importlib.import_module(f"{package}.srv")
    prefixes = [Path(sys.prefix), *Path(str(module.__file__)).parents]
    paths = (each / "share" / package / "srv" / f"{name}.srv" for each in prefixes)
    text = next(path for path in paths if path.is_file()).read_text(encoding="utf-8")
    request, _, response = text.partition("---")
    return request.strip() + "\n", response.strip() + "\n"
