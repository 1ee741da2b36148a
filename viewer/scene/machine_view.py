"""What is known of one machine: its model and the newest state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from viewer.scene.machine_model import MachineModel

__all__ = ["MachineView"]

Pose = tuple[float, float, float, float, float, float, float]


@dataclass
class MachineView:
    """One machine.

    Attributes:
        namespace: its namespace, which is also its id on the page.
        model: links, joints and shapes; None before its robot description.
        model_version: number of the last change of model, levers or pattern, over all machines of
            the scene, so that a machine that leaves and comes back has another one.
        levers: control that moves each joint, with a minus sign if in the opposite direction.
        pattern: iso or sae.
        time: simulation time of the joint values [s].
        joints: position [rad or m] and velocity by joint.
        base: position [m] and quaternion x, y, z, w of the base, map frame; None before the first.
        speed: travel speed, positive forward [m/s].
        power: power of all drives, without those that a load drives [W].
        payload: fill [heaped capacity = 1], mass [kg] and bank volume [m^3]; empty: not known.
        cylinders: pressures [Pa], force [N] and length [m] by joint.
        applied: command that took effect, by joint [rad/s] and track [m/s].
        is_stopped: whether the machine reports its emergency stop as pressed; None: not known.
        is_stop_requested: whether a press was published that the machine has not reported.
        has_ignored_levers: whether the machine ignores levers until they have been at rest.
        phase: phase of the operator; empty without one.
    """

    namespace: str
    model: MachineModel | None = None
    model_version: int = 0
    levers: dict[str, str] = field(default_factory=dict)
    pattern: str = "iso"
    time: float = 0.0
    joints: dict[str, tuple[float, float]] = field(default_factory=dict)
    base: Pose | None = None
    speed: float = 0.0
    power: float = 0.0
    payload: dict[str, float] = field(default_factory=dict)
    cylinders: dict[str, dict[str, float]] = field(default_factory=dict)
    applied: dict[str, float] = field(default_factory=dict)
    is_stopped: bool | None = None
    is_stop_requested: bool = False
    has_ignored_levers: bool = False
    phase: str = ""

    def start_run(self) -> None:
        """Discard the state of the run before; the model and the emergency stop remain."""
        self.time, self.base, self.speed, self.power, self.phase = 0.0, None, 0.0, 0.0, ""
        self.joints, self.payload, self.cylinders, self.applied = {}, {}, {}, {}

    @property
    def position(self) -> tuple[float, float] | None:
        """Horizontal position [m], map frame; None if it is not known."""
        if self.base is not None:
            return self.base[0], self.base[1]
        if "base_x" in self.joints and "base_y" in self.joints:
            return self.joints["base_x"][0], self.joints["base_y"][0]
        return None

    @property
    def load(self) -> float:
        """Power of the drives as a fraction of the rated power, 0 to 1; 0: unknown."""
        rated = None if self.model is None else self.model.rated_power
        return min(self.power / rated, 1.0) if rated else 0.0

    def joint_values(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return positions and velocities in the order of the model's joints, float32.

        A joint that follows another and is not reported has the value that follows from it; one
        that is not known is at 0.
        """
        joints = () if self.model is None else self.model.joints
        positions = np.zeros(len(joints), dtype=np.float32)
        velocities = np.zeros(len(joints), dtype=np.float32)
        for index, joint in enumerate(joints):
            found = self.joints.get(joint.name)
            if found is None and joint.mimic is not None:
                source = self.joints.get(joint.mimic.joint)
                if source is not None:
                    factor = joint.mimic.multiplier
                    found = (factor * source[0] + joint.mimic.offset, factor * source[1])
            if found is not None:
                positions[index], velocities[index] = found
        return positions, velocities

    def set_joints(
        self,
        time: float,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> None:
        """Set the values of joints at a simulation time [s]; missing velocities and efforts are 0.

        A drive takes power from the engine while it moves its joint; where the load moves the
        joint, as when a boom is lowered, the power is lost in the valves.
        """
        self.time = time
        zeros = [0.0] * len(names)
        rates = velocities if len(velocities) == len(names) else zeros
        torques = efforts if len(efforts) == len(names) else zeros
        pairs = zip(map(float, positions), map(float, rates), strict=False)
        self.joints = dict(zip(names, pairs, strict=False))
        self.power = sum(
            max(float(torque * rate), 0.0) for torque, rate in zip(torques, rates, strict=True)
        )

    def gauges(self) -> dict[str, Any]:
        """Return the values that the page shows as numbers, by name."""
        values: dict[str, Any] = {
            "joints": {
                name: value[0] for name, value in self.joints.items() if not is_base_joint(name)
            },
            "applied": self.applied,
            "stopped": self.is_stopped,
            "stop_requested": self.is_stop_requested,
            "levers_ignored": self.has_ignored_levers,
            "phase": self.phase,
            "speed": self.speed,
        }
        if self.payload:
            values["payload"] = self.payload
        if self.cylinders:
            values["cylinders"] = self.cylinders
        return values

    def set_cylinders(self, states: Mapping[str, Mapping[str, float]]) -> None:
        """Set the cylinders: length [m], force [N], pressures [Pa] by joint."""
        self.cylinders = {
            joint: {name: state[name] for name in ("cap", "rod", "force", "length")}
            for joint, state in states.items()
        }


def is_base_joint(name: str) -> bool:
    """Return whether a joint is one of the virtual joints from `map` to the base."""
    return name.startswith("base_") and name.removeprefix("base_") in (
        *("x", "y", "z", "yaw", "pitch", "roll"),
    )
