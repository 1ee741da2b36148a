"""Nodes on a small level site, in the executor of a test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import ArrayLike, NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Int64MultiArray
from std_srvs.srv import SetBool, Trigger

from machine_sim.machine import MachineSpec
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.machine_state import to_command_state
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.config_files import find_config
from msg_bridge.contract.ledger import Ledger
from msg_bridge.testing.ros_context import Ros
from soil_sim.node.soil_node import SoilNode
from support.machine_scenes import COMMAND_NAMES, excavator, load_shipped_machine

TICK = 0.01
SITE: dict[str, Any] = {"site.terrain": "flat", "site.num_points": 65, "site.cell": 0.4}


class Scene:
    """A soil node, machine nodes, and the received ledgers and diagnostics.

    Attributes:
        soil: the soil node.
        given: its parameters.
        ledgers: received ledgers, one a tick.
    """

    def __init__(self, ros: Ros, **parameters: Any) -> None:
        """Start a soil node with `parameters`, by default in lockstep."""
        self.ros = ros
        self._ledgers = ros.collect("/soil/ledger", Int64MultiArray)
        self._decoded: list[Ledger] = []
        self._diagnostics = ros.collect("/diagnostics", DiagnosticArray)
        self.given = {"sync": "lockstep", "tick_period": TICK, **SITE, **parameters}
        self.soil: SoilNode = ros.add(SoilNode, parameters=self.given)

    @property
    def ledgers(self) -> list[Ledger]:
        for message in self._ledgers[len(self._decoded) :]:
            ledger = from_multi_array(message)
            assert isinstance(ledger, Ledger)
            self._decoded.append(ledger)
        return self._decoded

    @property
    def tick(self) -> int:
        """Last tick of the soil."""
        return self.soil.run.tick

    @property
    def joined(self) -> tuple[int, ...]:
        return self.soil.run.endpoint.exchange.joined

    def machine(self, namespace: str = "/excavator", **parameters: Any) -> MachineNode:
        """Start a machine node, which joins later."""
        return self.ros.add(MachineNode, namespace=namespace, parameters=parameters)

    def until_tick(self, tick: int) -> None:
        """Spin until the soil has computed a tick and its ledger is received."""
        self.ros.spin_until(
            lambda: self.tick >= tick and self._ledgers and self.ledgers[-1].tick >= tick,
            what=f"tick {tick}",
        )

    def more_ticks(self, count: int) -> None:
        self.until_tick(self.tick + count)

    def trigger(self, service: str) -> Trigger.Response:
        return self.ros.call(Trigger, service, Trigger.Request())

    def pause(self, paused: bool = True) -> SetBool.Response:
        return self.ros.call(SetBool, "/sim/pause", SetBool.Request(data=paused))

    def step(self) -> None:
        response = self.trigger("/sim/step")
        assert response.success, response.message

    def leave(self, machine: MachineNode) -> None:
        """Stop and remove a machine as its process would."""
        machine.stop()
        self.ros.spin_until(lambda: not machine.stopping, what="the machine to have left")
        self.ros.remove(machine)

    def shown(self, node: Node) -> dict[str, str]:
        """Return the last received diagnostics of a node, with `message` and `level`."""
        name = f"{node.get_fully_qualified_name().lstrip('/')}: "
        for array in reversed(self._diagnostics):
            for status in array.status:
                if status.name.startswith(name):
                    values = {pair.key: pair.value for pair in status.values}
                    return {**values, "message": status.message, "level": str(status.level[0])}
        return {}

    def until_shown(self, node: SoilNode | MachineNode, key: str, value: Any) -> None:
        """Spin until the diagnostics of a node have a value; they are published without delay."""

        def holds() -> bool:
            node.diagnostics.publish()
            return self.shown(node).get(key) == str(value)

        condition = f"{key} {value} in the diagnostics"
        try:
            self.ros.spin_until(holds, what=condition)
        except AssertionError as error:
            raise AssertionError(f"{error}; they are {self.shown(node)}") from None


def ready_to_dig() -> MachineSpec:
    """Return the excavator with its lip just above level ground, 7 m ahead of it."""
    machine = excavator()
    return replace(machine, home=np.array([0.0, *lip_at(machine, 7.0, 0.1, 2.0)]))


def machine_file(folder: Path, machine: MachineSpec) -> str:
    """Write the file of a shipped machine with another home pose; return its path."""
    content = yaml.safe_load(find_config(f"machines/{machine.name}.yaml").read_text())
    home = [float(angle) for angle in machine.home]
    content["home"] = dict(zip(machine.joints, home, strict=True))
    path = folder / "ready.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return str(path)


def lip_at(
    machine: MachineSpec, reach: float, height: float, attitude: float
) -> NDArray[np.float64]:
    """Return angles of boom, arm and bucket for a position of the lip over level ground [rad]."""
    origin = float(arm_geometry(machine).swing[2])
    return np.array(solve_arm_angles(machine, reach, height - origin, attitude))


def drag_angles(machine: MachineSpec, fraction: float) -> NDArray[np.float64]:
    """Return angles of boom, arm, bucket at a fraction of a drag through the ground [rad]."""
    depth = 0.35 * np.sin(np.pi * fraction) - 0.1 * (1.0 - fraction)
    return lip_at(machine, 7.0 - 1.5 * fraction, -depth, 2.0 + 0.5 * fraction)


def drag_velocities(machine: MachineSpec, tick: int, ticks: int) -> NDArray[np.float64]:
    """Return the velocities of the tick after `tick`: drive, then drag; shape (6,)."""
    command = np.zeros(6)
    if tick < 30:
        command[4:] = 0.4, 0.3
    elif tick < ticks:
        angles = [drag_angles(machine, (t - 30) / (ticks - 30)) for t in (tick, tick + 1)]
        command[1:4] = (angles[1] - angles[0]) / TICK
        command[0] = 0.02
    return command


def ready_to_mill() -> MachineSpec:
    """Return the road header with its drum 5 cm above level ground."""
    return replace(load_shipped_machine("road_header"), home=np.array([0.0, 0.25, 0.0]))


def milling_velocities(machine: MachineSpec, tick: int, ticks: int) -> NDArray[np.float64]:
    """Return the velocities of the tick after `tick`: lower the drum and slew; shape (5,)."""
    speed = machine.joints["head"].max_velocity
    return np.array([0.2 * np.sin(0.03 * tick), 0.06, speed, 0.05, 0.04 * tick / ticks])


def joint_command(
    tick: int, velocities: ArrayLike, names: Sequence[str] = COMMAND_NAMES
) -> JointState:
    """Return a `joint_commands` message that answers the state of a tick."""
    return to_command_state(names, velocities, stamp_from_tick(tick, TICK))


def dig(
    scene: Scene, machine: MachineNode, enough: Callable[[Ledger], bool], name: str = ""
) -> Publisher:
    """Drag the bucket of a machine that is ready to dig until the ledger meets a condition.

    The machine needs a long `commands.command_timeout`. In a node with several machines, the first
    one digs; `name` is its name.
    """
    name = "/".join(filter(None, (machine.get_namespace(), name, "joint_commands")))
    publisher = scene.ros.publisher(name, JointState, subscriptions=1)
    scene.until_tick(1)
    for fraction in (0.3, 0.6, 0.9):
        goal = drag_angles(excavator(), fraction)
        names = ["boom", "arm", "bucket"]
        publisher.publish(JointState(name=names, position=goal.tolist()))
        run = machine.run

        def reached(goal: NDArray[np.float64] = goal, run: Any = run) -> bool:
            angles = run.sim.machine.joint_positions[1:]
            return bool(np.abs(angles - goal).max() < 0.05) or enough(scene.ledgers[-1])

        scene.ros.spin_until(reached, what=f"{fraction:.0%} of the drag")
    scene.ros.spin_until(lambda: enough(scene.ledgers[-1]), what="soil in the bucket")
    return publisher
