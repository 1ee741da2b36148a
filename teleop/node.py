"""The ROS node of teleoperation from a terminal: publishes `joy` and `emergency_stop`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Float64MultiArray, String

from machine_sim.commands import TRACK_NAMES, CommandParams
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import from_payload_array
from msg_bridge.codec.run_config import parse_section
from msg_bridge.codec.stamps import seconds_from_stamp
from msg_bridge.codec.status_levels import level_name
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.topics import parent_namespace, resolve
from msg_bridge.nodes.sim_node import SimNode
from teleop.joy_axes import to_joy
from teleop.key_layout import KEYS
from teleop.levers import Levers
from teleop.terminal_keys import QUERY, QUERY_PERIOD, TerminalKeys
from teleop.terminal_page import MachineView, page_lines

__all__ = ["Screen", "TeleopNode"]

_PERIOD = 0.02
"""Wall time between two messages [s]."""

_REDRAW_PERIOD = 0.1
"""Wall time between two updates of what is shown [s]."""

_REPORT_DELAY = 1.0
"""Wall time after a press or release in which diagnostics may report the state before it [s]."""

_SILENT_TIME = 1.0
"""Wall time without a state after which the machine counts as silent [s]."""


class Screen(Protocol):
    """Interface of `Terminal` that the node needs."""

    def read(self) -> bytes | None:
        """Return the bytes that have arrived; None if the terminal is closed."""

    def show(self, lines: Sequence[str]) -> None:
        """Replace what is shown."""

    def write(self, sequence: bytes) -> None:
        """Send a control sequence to the terminal."""


class TeleopNode(SimNode):
    """Drives the machine in its namespace by the keys of a terminal.

    The machine stops 0.3 s after the last message (`commands.command_timeout`), so also when this
    program ends or hangs.

    Attributes:
        finished: whether the user has quit.
        view: what is known of the machine.
        levers: deflections of levers and pedals.
    """

    def __init__(self, screen: Screen, speed: float = 1.0, **kwargs: Any) -> None:
        """
        Args:
            screen: the terminal.
            speed: full deflection of a held key, 0.1 to 1.
            kwargs: arguments of `rclpy.node.Node`; the namespace is that of the machine,
                `/excavator` by default.
        """
        super().__init__("teleop", **{"namespace": "/excavator", **kwargs})
        self.finished = False
        self.view, self.levers = MachineView(), Levers(speed)
        self._screen, self._keys = screen, TerminalKeys()
        self._params = CommandParams()
        self._must_release = False  # after an emergency stop, until no key is held
        self._commanded: list[str] = []  # joints that levers can move, without those of cylinders
        self._last_update = time.monotonic()
        self._last_stop_message = -float("inf")
        self._last_state = self._last_drawn = self._last_query = -float("inf")
        self._joy = self.create_publisher(Joy, topics.JOY, qos.STATE)
        self._stop = self.create_publisher(Bool, topics.EMERGENCY_STOP, qos.TRANSIENT_LOCAL)
        # Best effort: publishers of any QoS match, such as the live page.
        self.create_subscription(Bool, topics.EMERGENCY_STOP, self._on_stop, qos.COMMANDS)
        self.create_subscription(JointState, topics.JOINT_STATES, self._on_joints, qos.STATE)
        self.create_subscription(JointState, topics.APPLIED_COMMANDS, self._on_applied, qos.STATE)
        self.create_subscription(Float64MultiArray, topics.PAYLOAD, self._on_payload, qos.STATE)
        own, parent = self.get_namespace(), parent_namespace(self.get_namespace())
        # The node of several machines is in the parent namespace.
        for namespace in {own, parent}:
            topic = resolve(topics.MACHINE_CONFIG, namespace)
            self.create_subscription(String, topic, self._on_config, qos.TRANSIENT_LOCAL)
        for namespace in {parent, parent_namespace(parent)}:
            topic = resolve(topics.DIAGNOSTICS, namespace)
            self.create_subscription(DiagnosticArray, topic, self._on_diagnostics, 10)
        self._actions: dict[str, Callable[[], None]] = {
            " ": lambda: self._set_stop(True),
            "x": lambda: self._set_stop(False),
            "+": lambda: self.levers.change_speed(1),
            "=": lambda: self.levers.change_speed(1),  # the same key without shift
            "-": lambda: self.levers.change_speed(-1),
            "q": self._quit,
        }
        self.create_timer(_PERIOD, self._update)

    def stop(self) -> None:
        """Release the levers, so that the machine stops at once."""
        self.levers.release()
        self._publish()

    def _update(self) -> None:
        """Read the keys, move the levers and publish them."""
        now = time.monotonic()
        data = self._screen.read()
        if data is None:
            self._quit()
        for key in self._keys.feed(data or b"", now):
            self._actions.get(key, lambda: None)()
        self._query(now)
        self.levers.update(self._held(now), now - self._last_update)
        self._last_update = now
        self._publish()
        if now - self._last_drawn >= _REDRAW_PERIOD:
            self._last_drawn = now
            self.view.other_machines = self._find_other_machines()
            self.view.is_silent = now - self._last_state > _SILENT_TIME
            self._screen.show(
                page_lines(
                    self.get_namespace(),
                    self.view,
                    self.levers.deflections,
                    self.levers.speed,
                    has_releases=self._keys.has_releases,
                )
            )

    def _find_other_machines(self) -> list[str]:
        """Return the namespaces of other machines while this one has sent no state."""
        if self.view.sim_time is not None:
            return []
        end = f"/{topics.APPLIED_COMMANDS}"
        return sorted(
            topic.removesuffix(end)
            for topic, _ in self.get_topic_names_and_types()
            if topic.endswith(end)
            and topic != resolve(topics.APPLIED_COMMANDS, self.get_namespace())
            and self.count_publishers(topic)
        )

    def _query(self, now: float) -> None:
        """Ask the terminal for a sign of life while keys that move levers are held.

        Not at the end: the shell would receive the answer.
        """
        is_due = now - self._last_query >= QUERY_PERIOD and not self.finished
        if self._keys.has_releases and is_due and self._keys.held(now) & KEYS.keys():
            self._last_query = now
            self._screen.write(QUERY)

    def _held(self, now: float) -> set[str]:
        """Return the keys that move levers; after an emergency stop none until all were released.

        The machine requires the same, but levers at rest are published during the stop. Keys
        without a lever do not count: the one that releases the stop is pressed at that time.
        """
        held = self._keys.held(now) & KEYS.keys()
        self._must_release |= self.view.is_stopped
        if not (held or self.view.is_stopped):
            self._must_release = False
        return set() if self._must_release else held

    def _publish(self) -> None:
        values = to_joy(self.levers.deflections, self._params)
        message = Joy(axes=values.axes, buttons=values.buttons)
        message.header.stamp = self.get_clock().now().to_msg()
        self._joy.publish(message)

    def _set_stop(self, is_pressed: bool) -> None:
        self._on_stop(Bool(data=is_pressed))
        self._stop.publish(Bool(data=is_pressed))

    def _on_stop(self, msg: Bool) -> None:
        """Process a press or release by any publisher."""
        self._last_stop_message = time.monotonic()
        self._set_stopped(bool(msg.data))

    def _set_stopped(self, is_stopped: bool) -> None:
        self.view.is_stopped = is_stopped
        self._must_release |= self.view.is_stopped  # also if the release comes before an update

    def _quit(self) -> None:
        self.finished = True

    def _on_applied(self, msg: JointState) -> None:
        self._commanded = [name for name in msg.name if name not in TRACK_NAMES]

    def _on_joints(self, msg: JointState) -> None:
        self._last_state = time.monotonic()
        self.view.sim_time = seconds_from_stamp(msg.header.stamp)
        states = dict(zip(msg.name, zip(msg.position, msg.velocity, strict=False), strict=False))
        self.view.joints = {name: states[name] for name in self._commanded if name in states}

    def _on_payload(self, msg: Float64MultiArray) -> None:
        try:
            self.view.fill = from_payload_array(msg).fill
        except EarthmovingError:
            self.view.fill = None

    def _on_config(self, msg: String) -> None:
        """Take over the machine's assignment of axes."""
        try:
            self._params = CommandParams(**parse_section(msg.data, "commands"))
        except (EarthmovingError, TypeError, OverflowError) as error:
            self.view.condition = f"the configuration of the machine is not used: {error}"
            return
        self.view.pattern = self._params.joy_pattern

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        """Show the condition of the machine node, in this namespace or the parent."""
        own = self.get_namespace()
        for status in msg.status:
            namespace, _, name = f"/{status.name.partition(':')[0]}".rpartition("/")
            if name == "machine_sim" and (namespace or "/") in (own, parent_namespace(own)):
                self._read_stop(status, own.removeprefix(namespace).lstrip("/"))
                level = level_name(status)
                self.view.condition = f"{level}: {status.message}" if level != "OK" else level

    def _read_stop(self, status: DiagnosticStatus, name: str) -> None:
        """Take over the emergency stop that the machine reports: it may be older than this node.

        Args:
            status: diagnostics of the machine node.
            name: name of the machine in a node of several machines, else empty.
        """
        if time.monotonic() - self._last_stop_message < _REPORT_DELAY:
            return
        key = f"{name}/{topics.EMERGENCY_STOP}" if name else topics.EMERGENCY_STOP
        for entry in status.values:
            if entry.key == key and entry.value in ("True", "False"):
                self._set_stopped(entry.value == "True")
