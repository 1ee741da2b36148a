"""RosBackend: carries requests of pages out in the thread of the ROS executor.

Requests come from the thread of the web server. They are queued, and a guard condition wakes the
executor at once.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from sensor_msgs.msg import Joy
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from machine_sim.commands import CommandParams
from msg_bridge.codec import qos
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.topics import resolve
from msg_bridge.nodes.sim_node import SimNode
from teleop.joy_axes import to_joy
from viewer.recording import RecorderProcess
from viewer.server.backend import Recording, Reply
from viewer.sources.scene_writer import SceneWriter

__all__ = ["RosBackend"]

_SERVICE_TIME = 10.0
"""Wall time after which a service counts as not answering [s]."""

_LEVER_PAUSE = 0.2
"""Time without levers after which the next ones begin with a message of all at rest [s]."""

_SERVICES = {
    "pause": (SetBool, topics.PAUSE_SERVICE),
    "continue": (SetBool, topics.PAUSE_SERVICE),
    "step": (Trigger, topics.STEP_SERVICE),
    "reset": (Trigger, topics.RESET_SERVICE),
}


class RosBackend:
    """Requests of pages to a running simulation."""

    def __init__(
        self,
        node: SimNode,
        writer: SceneWriter,
        *,
        simulation_namespace: str,
        recorder: RecorderProcess | None,
    ) -> None:
        """
        Args:
            node: node of the publishers and service clients.
            writer: has the joystick assignment of each machine.
            simulation_namespace: namespace of the soil node.
            recorder: of the recordings; None if there is no folder for them.
        """
        self._node, self._writer, self._recorder = node, writer, recorder
        self._queue: deque[Callable[[], None]] = deque()
        self._publishers: dict[str, tuple[Any, Any]] = {}  # joy and emergency stop by machine
        self._levers_at: dict[str, float] = {}  # time of the last levers by machine [s]
        self._pending: list[tuple[float, Any, Any, Reply]] = []
        self._clients = {
            action: node.create_client(kind, resolve(name, simulation_namespace))
            for action, (kind, name) in _SERVICES.items()
        }
        self._guard = node.create_guard_condition(self._run_queue)
        node.create_timer(1.0, self._check_pending)

    # Called in the thread of the server.

    def publish_levers(self, machine: str, deflections: Mapping[str, float]) -> None:
        """Publish the deflections of the controls of a machine."""
        self._post(partial(self._publish_levers, machine, dict(deflections)))

    def set_emergency_stop(self, machine: str, pressed: bool) -> None:
        """Press or release the emergency stop of a machine."""
        self._post(partial(self._set_emergency_stop, machine, pressed))

    def control_simulation(self, action: str, reply: Reply) -> None:
        """Pause, continue, step or reset."""
        self._post(partial(self._call, action, reply))

    def record(self, on: bool, reply: Reply) -> None:
        """Start or stop a recording."""
        self._post(partial(self._record, on, reply))

    def recording(self) -> Recording:
        """Return the present recording, or the last one."""
        return Recording(False, "", 0) if self._recorder is None else self._recorder.state

    def _post(self, request: Callable[[], None]) -> None:
        self._queue.append(request)
        self._guard.trigger()

    # Called in the thread of the executor.

    def add_machine(self, machine: str) -> None:
        """Create the publishers of a machine, so that they are matched before the first command."""
        if machine not in self._publishers:
            self._publishers[machine] = (
                self._node.create_publisher(Joy, resolve(topics.JOY, machine), qos.STATE),
                self._node.create_publisher(
                    Bool, resolve(topics.EMERGENCY_STOP, machine), qos.TRANSIENT_LOCAL
                ),
            )

    def run_queue(self) -> None:
        """Carry out what is queued: at the end, when no executor does any more."""
        self._run_queue()

    def _run_queue(self) -> None:
        while self._queue:
            self._queue.popleft()()

    def _publish_levers(self, machine: str, deflections: dict[str, float]) -> None:
        if machine not in self._publishers:
            return
        now = time.monotonic()
        is_first = now - self._levers_at.get(machine, -math.inf) > _LEVER_PAUSE
        self._levers_at[machine] = now
        # Machines ignore an axis that is deflected in the first message of a device.
        at_rest = dict.fromkeys(deflections, 0.0)
        for each in (at_rest, deflections) if is_first else (deflections,):
            node = self._writer.node_of(machine)
            values = to_joy(each, self._writer.commands.get(node, CommandParams()))
            message = Joy(axes=values.axes, buttons=values.buttons)
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._publishers[machine][0].publish(message)

    def _set_emergency_stop(self, machine: str, pressed: bool) -> None:
        if machine in self._publishers:
            self._publishers[machine][1].publish(Bool(data=pressed))

    def _call(self, action: str, reply: Reply) -> None:
        client = self._clients[action]
        if not client.service_is_ready():
            reply(f"{client.srv_name} is not available; is a soil_sim running?")
            return
        kind, _ = _SERVICES[action]
        request = SetBool.Request(data=action == "pause") if kind is SetBool else kind.Request()
        future = client.call_async(request)
        self._pending.append((time.monotonic() + _SERVICE_TIME, client, future, reply))
        future.add_done_callback(partial(self._on_response, action, reply))

    def _on_response(self, action: str, reply: Reply, future: Any) -> None:
        self._pending = [each for each in self._pending if each[2] is not future]
        response = future.result()
        if response is not None and not response.success:
            reply(f"{action}: {response.message}")

    def _check_pending(self) -> None:
        """Report services that do not answer."""
        late = [each for each in self._pending if each[0] < time.monotonic()]
        self._pending = [each for each in self._pending if each not in late]
        for _, client, future, reply in late:
            client.remove_pending_request(future)
            reply(f"{client.srv_name} does not answer")

    def _record(self, on: bool, reply: Reply) -> None:
        if self._recorder is None:
            reply("there is no folder for recordings; set bag_folder")
            return
        try:
            if on:
                self._recorder.start()
            else:
                self._recorder.stop()
        except EarthmovingError as error:
            reply(str(error))
