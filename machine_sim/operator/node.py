"""The operator's node: an example of an autonomy stack that plugs in by public topics alone.

It sees what anybody can subscribe to (joints, odometry, payload, terrain, ledger) and sends what
anybody can send (`joint_commands`). Each command is stamped with the time of the state it answers,
so that a machine told to wait for it (`await_commands_every`) takes turns with it.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Int64MultiArray, String

from machine_sim.commands import TRACK_NAMES
from machine_sim.ground import surface_at
from machine_sim.machine import load_description
from machine_sim.operator.eyes import Eyes, Terrain
from machine_sim.operator.face import HEADER_JOINTS, FaceCut, FaceParams
from machine_sim.operator.moment import Moment, MomentGatherer
from machine_sim.operator.node_params import OperatorNodeParams
from machine_sim.operator.params import OperatorParams, ShiftParams
from machine_sim.operator.shift import Shift
from msg_bridge.codec import qos
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.headers import from_multi_array
from msg_bridge.codec.machine_state import PayloadState, from_payload_array, to_command_state
from msg_bridge.codec.poses import from_odometry
from msg_bridge.codec.sim_config import RunFacts, run_facts
from msg_bridge.codec.stamps import stamp_of_seconds, stamp_of_tick, tick_of_stamp
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.inbox import Inbox
from msg_bridge.nodes.lean_node import LeanNode
from msg_bridge.nodes.parameters import declare_parameters
from msg_bridge.nodes.runtime import run_node
from msg_bridge.nodes.terrain_listener import TerrainListener

__all__ = ["OperatorNode", "main"]

_REPEAT_PERIOD = 0.1
"""Wall time after which the last command is sent again while nothing new is seen [s]."""

_FIRST_LOOK = 2
"""Ticks that the first look is taken to last."""


class OperatorNode(LeanNode):
    """A scripted operator at the levers of the machine in its namespace.

    An excavator digs, a road header cuts a face.

    Attributes:
        task: what it is about.
        diagnostics: what `/diagnostics` says of it.
    """

    def __init__(self, **kwargs: Any) -> None:
        """
        Args:
            kwargs: for `rclpy.node.Node`; the namespace is `/excavator` if not given.

        Raises:
            EarthmovingError: a bad parameter or machine file.
        """
        super().__init__("operator", **{"namespace": "/excavator", **kwargs})
        params = declare_parameters(self, OperatorNodeParams)
        self._habits = declare_parameters(self, OperatorParams, "habits.")
        self._shift = declare_parameters(self, ShiftParams, "shift.")
        self._face = declare_parameters(self, FaceParams, "face.")
        self._description = load_description(find_config(params.machine))
        self._joints = self._description.joint_names
        self.diagnostics = Diagnostics(self, "operator")
        self._facts: RunFacts | None = None
        surface_at(np.zeros((2, 2)), 0.0, 0.0, 1.0, 0.0, 0.0)  # compiled now, not at the first dig
        self._begin()
        self._commands = self.create_publisher(JointState, "joint_commands", qos.STATE)
        self._phases = self.create_publisher(String, "operator/phase", qos.ROWS)
        self._cycles = self.create_publisher(String, "operator/cycles", qos.ROWS)
        self._inbox = Inbox(self, self._look)
        self._terrain = TerrainListener(self, self._inbox, self.diagnostics.refuse, self._look)
        self._hear(String, "/sim/config", qos.LATCHED, self._on_config)
        # Of a machine's state payload comes last, if it holds soil, of a tick the ledger: only they
        # are waited for.
        holds = self._holds = self._description.holds_soil
        self._hear(JointState, "joint_states", qos.STATE, self._on_joints, wakes=False)
        self._hear(Odometry, "odom", qos.STATE, self._on_odom, wakes=not holds)
        if holds:
            self._hear(Float64MultiArray, "payload", qos.STATE, self._on_payload)
        self._hear(Int64MultiArray, "/soil/ledger", qos.ROWS, self._on_ledger)
        self.create_timer(_REPEAT_PERIOD, self._repeat)

    @property
    def finished(self) -> bool:
        """Whether it has left the levers."""
        return self.task.done

    @property
    def exit_code(self) -> int:
        """1 if it gave up, else 0."""
        return 1 if self.task.given_up else 0

    def stop(self) -> None:
        """See that its last words arrive."""
        for publisher in (self._phases, self._cycles):
            publisher.wait_for_all_acked(Duration(seconds=2.0))

    @property
    def _lockstep(self) -> bool:
        return self._facts is not None and not self._facts.realtime

    def _begin(self) -> None:
        """Start the task, in this run of the soil or in a new one."""
        self.task: Shift | FaceCut
        if self._joints == HEADER_JOINTS:
            self.task = FaceCut(self._description, self._face)
        else:
            self.task = Shift(self._description, self._habits, self._shift)
        self._eyes = Eyes()
        self._moments = MomentGatherer(every=self._lockstep)
        self._last: JointState | None = None
        self._last_tick: int | None = None
        self._said, self._reported = "", 0

    # What it is told.

    def _hear(
        self,
        kind: Any,
        topic: str,
        profile: Any,
        take: Callable[[Any], None],
        *,
        wakes: bool = True,
    ) -> None:
        def on_message(msg: Any) -> None:
            try:
                take(msg)
            except EarthmovingError as error:
                self.diagnostics.refuse(topic, str(error))

        self._inbox.subscribe(kind, topic, profile, on_message, wakes=wakes)

    def _on_config(self, msg: String) -> None:
        facts = run_facts(msg.data)
        before, self._facts = self._facts, facts
        if before is None or facts.epoch != before.epoch:
            if before is not None:
                self.get_logger().info("the run has begun anew, and so does the task")
            self._begin()
        self._terrain.follower.begin(facts.epoch)
        self._terrain.maps.set_cell(facts.cell)

    def _on_joints(self, msg: JointState) -> None:
        if self._facts is not None:
            tick = tick_of_stamp(msg.header.stamp, self._facts.tick)
            self._moments.joints(tick, _angles(msg, self._joints))

    def _on_odom(self, msg: Odometry) -> None:
        if self._facts is not None:
            tick = tick_of_stamp(msg.header.stamp, self._facts.tick)
            self._moments.base(tick, from_odometry(msg))
            if not self._holds:
                self._moments.payload(tick, PayloadState(0.0, 0.0, 0.0, 0.0))

    def _on_payload(self, msg: Float64MultiArray) -> None:
        if self._facts is not None:
            payload = from_payload_array(msg)
            tick = tick_of_stamp(stamp_of_seconds(payload.time), self._facts.tick)
            self._moments.payload(tick, payload)

    def _on_ledger(self, msg: Int64MultiArray) -> None:
        ledger = from_multi_array(msg)
        if isinstance(ledger, Ledger):
            self._moments.ledger(ledger)

    # What it does.

    def _look(self) -> None:
        """Answer a new moment with a command."""
        follower, facts = self._terrain.follower, self._facts
        if facts is None or follower.epoch != facts.epoch:
            return
        while not self.task.done:
            if self._lockstep:
                follower.go_on_to(self._moments.next_tick or 0)
            moment = self._moments.take(follower.tick)
            if moment is None:
                return
            self._answer(moment, facts)

    def _answer(self, moment: Moment, facts: RunFacts) -> None:
        follower = self._terrain.follower
        assert follower.grid is not None, "a tick of terrain is known"
        terrain = Terrain(follower.grid, follower.elevation, follower.revision)
        state = (moment.joints, moment.base, moment.payload)
        view = self._eyes.see(moment.tick * facts.tick, *state, terrain, moment.ledger)
        since = _FIRST_LOOK if self._last_tick is None else moment.tick - self._last_tick
        self._last_tick = moment.tick
        command = self.task.command(view, since * facts.tick)
        self._tell(view.time)
        if self.task.done:
            return
        self._last = to_command_state(
            (*self._joints, *TRACK_NAMES),
            np.concatenate([command.joints, command.tracks]),
            stamp_of_tick(moment.tick, facts.tick),
        )
        self._commands.publish(self._last)

    def _repeat(self) -> None:
        """Say again what was perhaps not heard: in lockstep the machine may be waiting for it."""
        if self._lockstep and self._last is not None and not self.task.done:
            self._commands.publish(self._last)

    def _tell(self, time: float) -> None:
        """Publish what it is about, and how each cycle went."""
        task = self.task
        for report in task.reports[self._reported :]:
            self._cycles.publish(String(data=json.dumps(asdict(report))))
            self._reported += 1
        now = {"cycle": task.cycle, "phase": task.phase, "given_up": task.given_up}
        said = json.dumps(now)
        if said != self._said:
            self._said = said
            self._phases.publish(String(data=json.dumps({"time": time, **now})))
            self.diagnostics.set("cycle", task.cycle)
            self.diagnostics.set("phase", task.phase)


def _angles(msg: JointState, names: Sequence[str]) -> list[float]:
    """Angles of some joints [rad], in the order of `names`.

    Raises:
        CodecError: one of them is missing or no angle.
    """
    angles = dict(zip(msg.name, msg.position, strict=False))
    own = [angles.get(name, math.nan) for name in names]
    if not all(map(math.isfinite, own)):
        raise CodecError(f"the joint states need a finite angle of {', '.join(names)}")
    return own


def main(args: list[str] | None = None) -> int:
    """Run the node until its task is done or it is stopped."""
    return run_node(OperatorNode, args)


if __name__ == "__main__":
    sys.exit(main())
