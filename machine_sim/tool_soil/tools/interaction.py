"""What every kind of tool implements to act on soil, and null objects for what a kind lacks."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from machine_sim.machine import Tool
from machine_sim.machine.box import Vec3
from machine_sim.params import MachineSimParams
from machine_sim.tool_soil.payload import Payload
from msg_bridge.contract.rows import UNLIMITED_ROOM, Rows

__all__ = [
    "NoPendingSoil",
    "NoResistance",
    "PendingAccount",
    "ToolInteraction",
    "ToolMotion",
    "ToolResistance",
    "Twist",
    "Wrench",
]

Array = NDArray[np.float64]

NO_PUSH: Vec3 = (0.0, 0.0, 0.0)
"""Push of a tool that holds no soil [N]."""

Twist = tuple[Vec3, Vec3]
"""Velocity of a frame's origin [m/s] and angular velocity [rad/s], map axes."""

Wrench = tuple[Vec3, Vec3]
"""Force [N] and torque about a frame's origin [N m], map axes."""


class ToolMotion(NamedTuple):
    """Motion of a tool during one tick.

    Attributes:
        start, end: pose of the tool's non-spinning frame at the start and the end of the tick.
        room_mm3: bank volume that the tool can take in [mm^3].
        is_driven: whether it is a drum that spins or is commanded to spin.
        work: work that a drum can deliver to the soil [J]; 0 for any other tool.
    """

    start: Pose
    end: Pose
    room_mm3: int = UNLIMITED_ROOM
    is_driven: bool = False
    work: float = 0.0


class PendingAccount(Protocol):
    """Soil that a tool has excavated and that is not yet particles."""

    @property
    def total_mm3(self) -> int:
        """Bank volume [mm^3]."""
        ...

    @property
    def accounted_water(self) -> int:
        """Water (volume times moisture) of the pending soil, plus the rounding error [mm^3 %]."""
        ...

    @property
    def state(self) -> NDArray[np.generic]:
        """Values for the state hash."""
        ...

    def clear(self) -> None:
        """Remove all pending soil."""
        ...

    def discard(self, volume: int) -> int:
        """Remove up to a volume of pending soil [mm^3]; return what was removed."""
        ...

    def receive(self, conversions: Rows, pose: Pose, tick: int) -> None:
        """Credit the EXCAVATE rows among the CONVERSION rows of a tool at a pose."""
        ...

    def release(
        self, particles: SoilEngine, pose: Pose, tick: int, release_twist: Twist | None = None
    ) -> int:
        """Insert particles into the engine, and return their number."""
        ...


class ToolResistance(Protocol):
    """Force of the ground on a tool that cuts it or rests on it."""

    @property
    def is_active(self) -> bool:
        """Whether soil resists or supports the tool."""
        ...

    @property
    def inflow_fraction(self) -> float:
        """Fraction of the room of the tool that the soil ahead can push soil into, 0 to 1."""
        ...

    @property
    def deliverable_work(self) -> float:
        """Work that a drum can deliver to the soil in a tick [J]; 0 for any other tool."""
        ...

    @property
    def state(self) -> Array:
        """Values for the state hash: all that the next steps depend on."""
        ...

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Take FORCE rows of the tool, shape (n,), n >= 1, and its pose in the tick they answer."""
        ...

    def begin_tick(self) -> None:
        """Begin a tick; a wrench without update expires."""
        ...

    def reset(self) -> None:
        """Remove all wrenches until the next FORCE rows."""
        ...

    def step(self, pose: Pose, velocity: Twist, dt: float, push: Vec3 = NO_PUSH) -> Wrench:
        """Return the wrench on the tool in the next physics step of `dt` [s].

        Args:
            pose: of the tool frame.
            velocity: of its origin [m/s], and angular [rad/s], map axes.
            dt: physics step [s].
            push: force of the soil in the tool on it, without the weight of that soil [N], map
                axes.
        """
        ...


class ToolInteraction(Protocol):
    """How one kind of tool acts on soil; built from the tool's shape and its id.

    Attributes:
        is_digging: whether the tool excavates: it has pending soil and resistance.
        is_milling: whether it excavates as a drum does.
    """

    is_digging: bool
    is_milling: bool

    @property
    def key_points(self) -> Array:
        """Key points of the cutting contour [m], tool frame, shape (n, 3); n = 0 without one."""
        ...

    def sweep(self, motion: ToolMotion) -> Rows:
        """Return the SWEEP rows of one tick."""
        ...

    def make_pending(
        self, rng: np.random.Generator, *, nominal_mm3: int, max_per_tick: int
    ) -> PendingAccount:
        """Return an empty account of excavated soil; arguments as for `PendingSoil`."""
        ...

    def make_resistance(
        self, tool: Tool, machine_mass: float, params: MachineSimParams
    ) -> ToolResistance:
        """Return the resistance of a tool on a machine of a mass [kg], by the node's stepping."""
        ...

    def release_twist(self, tool: Tool) -> Twist | None:
        """Return the twist that released particles start with; None: they start at rest."""
        ...

    def measure(self, particles: SoilEngine, pose: Pose) -> tuple[Payload, float]:
        """Measure the soil that the tool carries at a pose, and the room for more.

        Returns:
            The payload, and the bank volume that the tool can take in [mm^3], negative if it is
            fuller than that, infinite without a limit.
        """
        ...


class NoPendingSoil:
    """Account of a tool that does not excavate: always empty."""

    total_mm3 = 0
    accounted_water = 0
    state: NDArray[np.generic] = np.zeros(0)

    def clear(self) -> None:
        """Do nothing."""

    def discard(self, volume: int) -> int:
        """Return 0: there is none."""
        return 0

    def receive(self, conversions: Rows, pose: Pose, tick: int) -> None:
        """Accept no rows: none belong to a tool that does not excavate."""

    def release(
        self, particles: SoilEngine, pose: Pose, tick: int, release_twist: Twist | None = None
    ) -> int:
        """Release nothing."""
        return 0


class NoResistance:
    """Resistance of a tool that the ground exerts no force on."""

    is_active = False
    inflow_fraction = 1.0
    deliverable_work = 0.0
    state: Array = np.zeros(0)

    def receive(self, rows: Rows, pose: Pose) -> None:
        """Ignore FORCE rows."""

    def begin_tick(self) -> None:
        """Do nothing."""

    def reset(self) -> None:
        """Do nothing."""

    def step(self, pose: Pose, velocity: Twist, dt: float, push: Vec3 = NO_PUSH) -> Wrench:
        """Return no force and no torque."""
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
