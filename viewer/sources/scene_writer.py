"""SceneWriter: sets a Scene from ROS messages of public topics, live or from a bag."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Bool, Float64MultiArray, String

from machine_sim.commands import CommandParams
from machine_sim.commands.joystick import LEVER_PATTERNS
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.json_object import parse_json_object
from msg_bridge.codec.labelled_array import array_label
from msg_bridge.codec.machine_state import from_cylinder_array, from_payload_array
from msg_bridge.codec.particles import from_particle_cloud
from msg_bridge.codec.poses import from_odometry
from msg_bridge.codec.run_config import parse_run_facts, parse_section, soil_kinds
from msg_bridge.codec.stamps import seconds_from_stamp
from msg_bridge.codec.status_levels import level_name
from msg_bridge.codec.terrain import cells_of_terrain_cloud, terrain_of_cells
from msg_bridge.codec.terrain_tiles import tile_from_cdr
from msg_bridge.codec.tile_assembly import TileAssembly
from msg_bridge.contract import topics
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message, RowChunk
from msg_bridge.contract.rows import Rows
from msg_bridge.contract.topics import resolve
from viewer.scene.machine_model import MachineModel
from viewer.scene.scene import Scene, SoilColor
from viewer.scene.terrain_surface import SurfaceMap
from viewer.scene.terrain_tiles import SurfaceLayers
from viewer.scene.urdf import parse_urdf
from viewer.sources.machine_files import spec_in_config

__all__ = ["SceneWriter", "node_of_status"]

_IGNORED_AXES = "ignored_axes"
"""Value of the diagnostics of a machine: axes that it ignores until they have been at rest."""

_MAX_STATUS_LENGTH = 300
_MAX_STATUS_ENTRIES = 50
_MAX_COMMAND_VALUES = 64


class SceneWriter:
    """Sets a scene from messages.

    Each method takes one message and may raise `EarthmovingError`, with the scene unchanged. A
    machine is named by its namespace.

    Attributes:
        scene: the scene.
        commands: parameters of the command inputs, by the namespace of the machine node.
    """

    def __init__(self, scene: Scene, namespace: str = "") -> None:
        """
        Args:
            scene: the scene.
            namespace: leading part of the full names of nodes that namespaces of machines lack.
        """
        self.scene = scene
        self._namespace = namespace
        self.commands: dict[str, CommandParams] = {}
        self._cell: float | None = None
        self._config_text = ""
        self._machine_configs: dict[str, str] = {}
        self._pending_map: Rows | None = None  # points, until their cell size is known
        self._tiles = TileAssembly()

    # The simulation.

    def on_config(self, msg: String) -> None:
        """Start the run that a configuration names."""
        if msg.data == self._config_text:
            return
        facts = parse_run_facts(msg.data)
        try:
            kinds = soil_kinds(msg.data)
        except CodecError:  # of a recording without names of soils
            kinds = ()
        self._config_text, self._cell = msg.data, facts.cell
        with self.scene.lock:
            self.scene.start_run(facts.run_id)
            self.scene.set_soils(tuple(SoilColor(kind.name, kind.colour) for kind in kinds))
        if self._pending_map is not None:
            self._on_cells(self._pending_map)

    def discard_config(self) -> None:
        """Return to the state before any configuration."""
        self._config_text, self._cell = "", None
        with self.scene.lock:
            self.scene.terrain.clear_run()

    def on_map(self, msg: PointCloud2) -> None:
        """Process a map, if it is needed."""
        self._on_cells(cells_of_terrain_cloud(msg))

    def on_tile(self, data: bytes) -> None:
        """Process a serialised tile of a large terrain."""
        if self._tiles.add(tile_from_cdr(data)) and self._tiles.cells is not None:
            self._on_cells(self._tiles.cells)

    def _on_cells(self, cells: Rows) -> None:
        """Process the points of a map, if it is needed."""
        run_id, revision = int(cells["run_id"][0, 0]), int(cells["revision"][0, 0])
        with self.scene.lock:
            is_needed = self.scene.terrain.is_needed(run_id, revision)
            if not is_needed:
                self.scene.terrain.skip_map(revision)
        if not is_needed:
            return
        try:
            surface = self._surface(cells)
        except CodecError as error:
            # A soil node with another cell size has started; its configuration follows.
            if error.code is ErrorCode.GRID and run_id != self.scene.run_id:
                self._pending_map = cells
                return
            raise
        self._pending_map = None
        with self.scene.lock:
            run_before = self.scene.terrain.run_id
            self.scene.terrain.receive_map(surface)
            if self.scene.terrain.run_id != run_before:
                self.scene.discard_run()
            self.scene.terrain_changed()

    def decode_map(self, msg: PointCloud2) -> SurfaceMap:
        """Return the surface in a map, with the cell size of the configuration.

        Raises:
            CodecError: as `from_terrain_cloud`.
        """
        return self._surface(cells_of_terrain_cloud(msg))

    def _surface(self, cells: Rows) -> SurfaceMap:
        """Return the surface in the points of a map.

        Raises:
            CodecError: as `terrain_of_cells`.
        """
        found = terrain_of_cells(cells, cell=self._cell)
        keyframe, difference = found.keyframe, found.design_difference
        height = keyframe.elevation.astype(np.float32)
        layers = SurfaceLayers(height, found.loose_depth, found.soil, found.moisture)
        design = None if np.isnan(difference).all() else height - difference
        return SurfaceMap(keyframe.run_id, keyframe.revision, keyframe.grid, layers, design)

    def on_map_updates(self, chunk: RowChunk) -> None:
        """Process rows of changed cells."""
        with self.scene.lock:
            self.scene.terrain.receive_updates(chunk)
            self.scene.terrain_changed()

    def on_ledger(self, message: Message | Ledger) -> None:
        """Process the end of a tick."""
        if not isinstance(message, Ledger):
            raise ExchangeError("only ledgers belong on this topic", ErrorCode.STREAM_DIRECTION)
        with self.scene.lock:
            if message.run_id == self.scene.run_id:
                self.scene.set_tick(message)

    def on_paused(self, msg: Bool) -> None:
        """Process whether time stands still."""
        with self.scene.lock:
            self.scene.is_paused = bool(msg.data)
            self.scene.version += 1

    def on_diagnostics(self, msg: DiagnosticArray) -> None:
        """Process the conditions of nodes, and the emergency stops that machines report."""
        with self.scene.lock:
            for status in msg.status:
                name = node_of_status(status)
                for machine, is_stopped in self.reported_stops(status):
                    self.scene.set_stop(machine, is_stopped)
                for machine, axes in self._machine_values(status, _IGNORED_AXES):
                    if machine in self.scene.machines:
                        self.scene.machines[machine].has_ignored_levers = bool(axes)
                if name not in self.scene.status and len(self.scene.status) >= _MAX_STATUS_ENTRIES:
                    continue
                level = level_name(status)
                text = status.message[:_MAX_STATUS_LENGTH]
                self.scene.set_condition(name, level if level == "OK" else f"{level}: {text}")
            self.scene.version += 1

    def on_recorder_status(self, msg: String) -> None:
        """Process what a recording has lost."""
        lost = parse_json_object(msg.data, {"lost": dict}, "the status of the recorder")["lost"]
        text = ", ".join(f"{count} on {topic}" for topic, count in lost.items())
        with self.scene.lock:
            condition = f"WARN: lost {text}"[:_MAX_STATUS_LENGTH] if lost else "OK"
            self.scene.set_condition("recording", condition)

    def reported_stops(self, status: DiagnosticStatus) -> Iterator[tuple[str, bool]]:
        """Yield machine and emergency stop, as the diagnostics of a machine node state them."""
        for machine, value in self._machine_values(status, topics.EMERGENCY_STOP):
            if value in ("True", "False"):
                yield machine, value == "True"

    def _machine_values(self, status: DiagnosticStatus, key: str) -> Iterator[tuple[str, str]]:
        """Yield each machine of a machine node with its value of a key in the diagnostics."""
        node = f"/{node_of_status(status)}".removeprefix(self._namespace).rpartition("/")[0]
        for entry in status.values:
            name, _, found = entry.key.rpartition("/")
            if found == key:
                yield resolve(name, node) if name else node, entry.value

    # A machine node.

    def on_particles(self, node: str, msg: PointCloud2) -> None:
        """Process the particles of a machine node."""
        self.set_particles(node, from_particle_cloud(msg))

    def set_particles(self, node: str, rows: Rows) -> None:
        """Set the particles of a machine node, PARTICLE rows."""
        with self.scene.lock:
            self.scene.set_particles(node, rows)

    def on_machine_config(self, node: str, msg: String) -> None:
        """Process the configuration of a machine node: how its joysticks are assigned."""
        if self._machine_configs.get(node) == msg.data:
            return
        try:
            self.commands[node] = CommandParams(**parse_section(msg.data, "commands"))
        except (TypeError, OverflowError) as error:
            raise CodecError(f"the section 'commands': {error}", ErrorCode.VALUE) from None
        self._machine_configs[node] = msg.data
        with self.scene.lock:
            for namespace in self.scene.machines:
                if self.node_of(namespace) == node:
                    self._assign_levers(namespace)

    def node_of(self, machine: str) -> str:
        """Return the namespace of the machine node of a machine: its own, or its parent."""
        parent = machine.rpartition("/")[0]
        return parent if parent in self._machine_configs else machine

    # A machine.

    def on_description(self, machine: str, msg: String) -> None:
        """Process the robot description of a machine."""
        self.set_model(machine, parse_urdf(msg.data))

    def set_model(self, machine: str, model: MachineModel) -> None:
        """Set links, joints and shapes of a machine."""
        with self.scene.lock:
            view = self.scene.machine(machine)
            if model != view.model:
                view.model = model
                self._assign_levers(machine)
                self.scene.model_changed(view)

    def on_joints(self, machine: str, msg: JointState) -> None:
        """Process the values of all joints."""
        if len(msg.position) != len(msg.name):
            raise CodecError("joint states need a position for each name", ErrorCode.LAYOUT)
        if not np.isfinite([*msg.position, *msg.velocity, *msg.effort]).all():
            raise CodecError("joint states are not finite", ErrorCode.VALUE)
        with self.scene.lock:
            time = seconds_from_stamp(msg.header.stamp)
            self.scene.machine(machine).set_joints(
                time, msg.name, msg.position, msg.velocity, msg.effort
            )
            self.scene.machines_changed()

    def on_odometry(self, machine: str, msg: Odometry) -> None:
        """Process pose and speed of the base."""
        base = from_odometry(msg)
        x, y, z = np.asarray(base.position).tolist()
        qx, qy, qz, qw = np.asarray(base.quaternion).tolist()
        speed = msg.twist.twist.linear.x
        with self.scene.lock:
            view = self.scene.machine(machine)
            view.base, view.speed = (x, y, z, qx, qy, qz, qw), speed
            self.scene.machines_changed()

    def on_payload(self, machine: str, msg: Float64MultiArray) -> None:
        """Process what a machine carries."""
        payload = from_payload_array(msg)
        values = {"fill": payload.fill, "mass": payload.mass_kg, "bank_m3": payload.bank_m3}
        if not all(map(math.isfinite, values.values())):
            raise CodecError("the payload is not finite", ErrorCode.VALUE)
        with self.scene.lock:
            self.scene.machine(machine).payload = values
            self.scene.machines_changed()

    def on_cylinders(self, machine: str, msg: Float64MultiArray) -> None:
        """Process the cylinders of a machine."""
        suffix = "_length_m"
        labels = array_label(msg).split(",")
        joints = [each.removesuffix(suffix) for each in labels if each.endswith(suffix)]
        states, _ = from_cylinder_array(msg, joints)
        if not all(math.isfinite(value) for state in states.values() for value in state):
            raise CodecError("the cylinders are not finite", ErrorCode.VALUE)
        values = {
            joint: {
                "length": state.length,
                "force": state.force,
                "cap": state.cap_side_pressure,
                "rod": state.rod_side_pressure,
            }
            for joint, state in states.items()
        }
        with self.scene.lock:
            self.scene.machine(machine).set_cylinders(values)
            self.scene.machines_changed()

    def on_applied(self, machine: str, msg: JointState) -> None:
        """Process the command that took effect."""
        pairs = list(zip(msg.name, map(float, msg.velocity), strict=False))[:_MAX_COMMAND_VALUES]
        if not all(math.isfinite(value) for _, value in pairs):
            raise CodecError("the applied command is not finite", ErrorCode.VALUE)
        with self.scene.lock:
            self.scene.machine(machine).applied = dict(pairs)
            self.scene.machines_changed()

    def on_emergency_stop(self, machine: str, msg: Bool) -> None:
        """Process a published press or release: a request, which the machine's report confirms."""
        with self.scene.lock:
            self.scene.request_stop(machine, bool(msg.data))

    def on_unreported_stop(self, machine: str, msg: Bool) -> None:
        """Process a published press or release to a machine that reports no emergency stop."""
        with self.scene.lock:
            self.scene.set_stop(machine, bool(msg.data))

    def on_phase(self, machine: str, msg: String) -> None:
        """Process the phase of the operator."""
        found = parse_json_object(msg.data, {"phase": str, "cycle": int}, "the phase")
        with self.scene.lock:
            self.scene.machine(machine).phase = f"{found['phase']} {found['cycle']}"
            self.scene.machines_changed()

    def _assign_levers(self, machine: str) -> None:
        """Set the control that moves each joint of a machine, if it differs; the lock is held."""
        view, node = self.scene.machines[machine], self.node_of(machine)
        params = self.commands.get(node)
        if params is None or view.model is None:
            return
        spec = spec_in_config(self._machine_configs[node], machine)
        own_axes = {} if spec is None else spec.joystick_axes
        axes = own_axes or LEVER_PATTERNS[params.joy_pattern]
        levers = {
            joint: axis if sign > 0.0 else f"-{axis}"
            for joint, (axis, sign) in axes.items()
            if joint in view.model.joint_index
        }
        if (levers, params.joy_pattern) != (view.levers, view.pattern):
            view.levers, view.pattern = levers, params.joy_pattern
            self.scene.model_changed(view)


def node_of_status(status: DiagnosticStatus) -> str:
    """Return the full name of the node that has published a status, without a leading slash."""
    return str(status.name.partition(":")[0])
