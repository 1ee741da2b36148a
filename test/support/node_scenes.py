"""Nodes on a small level site, built and spun in a test's own executor."""

from __future__ import annotations

from collections.abc import Callable
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
from support.machine_scenes import COMMAND_NAMES, excavator

TICK = 0.01
SITE: dict[str, Any] = {"site.terrain": "flat", "site.num_points": 65, "site.cell": 0.4}


class Scene:
    """A soil's node and what is received of it.

    Attributes:
        soil: the node.
        ledgers: of each tick, as received.
    """

    def __init__(self, ros: Ros, **parameters: Any) -> None:
        """`parameters` are the soil's; in lockstep unless they say otherwise."""
        self.ros = ros
        self._ledgers = ros.collect("/soil/ledger", Int64MultiArray)
        self._diagnostics = ros.collect("/diagnostics", DiagnosticArray)
        given = {"sync": "lockstep", "tick_period": TICK, **SITE, **parameters}
        self.soil: SoilNode = ros.add(SoilNode, parameters=given)

    @property
    def ledgers(self) -> list[Ledger]:
        found = [from_multi_array(message) for message in self._ledgers]
        assert all(isinstance(ledger, Ledger) for ledger in found)
        return found  # type: ignore[return-value]

    @property
    def tick(self) -> int:
        """The soil's."""
        return self.soil.run.tick

    @property
    def joined(self) -> tuple[int, ...]:
        return self.soil.run.endpoint.exchange.joined

    def machine(self, namespace: str = "/excavator", **parameters: Any) -> MachineNode:
        """A machine's node; it has not joined yet."""
        return self.ros.add(MachineNode, namespace=namespace, parameters=parameters)

    def until_tick(self, tick: int) -> None:
        """Until the soil has done a tick, and those who listen have received of it."""
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
        """End a machine as its process would."""
        machine.stop()
        self.ros.spin_until(lambda: not machine.stopping, what="the machine to have left")
        self.ros.remove(machine)

    def shown(self, node: Node) -> dict[str, str]:
        """What `/diagnostics` says of a node, as last received; `message` and `level` included."""
        name = f"{node.get_fully_qualified_name().lstrip('/')}: "
        for array in reversed(self._diagnostics):
            for status in array.status:
                if status.name.startswith(name):
                    values = {pair.key: pair.value for pair in status.values}
                    return {**values, "message": status.message, "level": str(status.level[0])}
        return {}

    def until_shown(self, node: SoilNode | MachineNode, key: str, value: Any) -> None:
        """Until `/diagnostics` has a value under a key; it is published without waiting."""

        def holds() -> bool:
            node.diagnostics.publish()
            return self.shown(node).get(key) == str(value)

        wanted = f"{key} {value} in the diagnostics"
        try:
            self.ros.spin_until(holds, what=wanted)
        except AssertionError as error:
            raise AssertionError(f"{error}; they are {self.shown(node)}") from None


def ready_to_dig() -> MachineSpec:
    """The excavator with its lip just above level ground, 7 m before it."""
    machine = excavator()
    return replace(machine, home=np.array([0.0, *lip_at(machine, 7.0, 0.1, 2.0)]))


def machine_file(folder: Path, machine: MachineSpec) -> str:
    """A machine file of the excavator with another home."""
    content = yaml.safe_load(find_config("machines/excavator.yaml").read_text())
    home = [float(angle) for angle in machine.home]
    content["home"] = dict(zip(machine.joints, home, strict=True))
    path = folder / "ready.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return str(path)


def lip_at(
    machine: MachineSpec, reach: float, height: float, attitude: float
) -> NDArray[np.float64]:
    """Angles of boom, arm and bucket that put the lip somewhere before it [m] (level ground)."""
    origin = float(arm_geometry(machine).swing[2])
    return np.array(solve_arm_angles(machine, reach, height - origin, attitude))


def drag_angles(machine: MachineSpec, part: float) -> NDArray[np.float64]:
    """Angles of boom, arm, bucket at a part, 0 to 1, of a drag through the ground."""
    depth = 0.35 * np.sin(np.pi * part) - 0.1 * (1.0 - part)
    return lip_at(machine, 7.0 - 1.5 * part, -depth, 2.0 + 0.5 * part)


def drag_velocities(machine: MachineSpec, tick: int, ticks: int) -> NDArray[np.float64]:
    """What to do in the tick after `tick`: drive a little, then drag; shape (6,)."""
    command = np.zeros(6)
    if tick < 30:
        command[4:] = 0.4, 0.3
    elif tick < ticks:
        way = [drag_angles(machine, (t - 30) / (ticks - 30)) for t in (tick, tick + 1)]
        command[1:4] = (way[1] - way[0]) / TICK
        command[0] = 0.02
    return command


def joint_command(tick: int, velocities: ArrayLike) -> JointState:
    """A `joint_commands` message that answers the state of a tick."""
    return to_command_state(COMMAND_NAMES, velocities, stamp_from_tick(tick, TICK))


def dig(
    scene: Scene, machine: MachineNode, enough: Callable[[Ledger], bool], name: str = ""
) -> Publisher:
    """Have a machine that is ready to dig put its lip into the ground and draw it in.

    Its `commands.command_timeout` must be long. Of several in its node it is the first, of a name.
    """
    name = "/".join(filter(None, (machine.get_namespace(), name, "joint_commands")))
    publisher = scene.ros.publisher(name, JointState, subscriptions=1)
    scene.until_tick(1)
    way = (0.3, 0.6, 0.9)
    for part in way:
        goal = drag_angles(excavator(), part)
        names = ["boom", "arm", "bucket"]
        publisher.publish(JointState(name=names, position=goal.tolist()))
        run = machine.run

        def there(goal: NDArray[np.float64] = goal, run: Any = run) -> bool:
            angles = run.sim.machine.joint_positions[1:]
            return bool(np.abs(angles - goal).max() < 0.05) or enough(scene.ledgers[-1])

        scene.ros.spin_until(there, what=f"{part} of the drag")
    scene.ros.spin_until(lambda: enough(scene.ledgers[-1]), what="soil in the bucket")
    return publisher
