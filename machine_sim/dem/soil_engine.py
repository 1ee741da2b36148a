"""What every engine of loose soil has: bodies with an account, tools that move, and a ground."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.lifecycle.landing import settled_rows
from machine_sim.dem.materials import ContactMaterials
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.state import ParticleError, ParticleState
from machine_sim.dem.tools.pose import Pose
from machine_sim.dem.tools.rigid_tool import ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["SoilEngine"]


class SoilEngine(ABC):
    """Soil as bodies, and the tools and terrain they touch.

    Attributes:
        params: physics.
        ground: terrain; `Ground.advance` is its owner's to call.
        soils: what is known of each soil, by its id.
        store: the bodies, see `ParticleState`.
        num_plate_tunnellings: centres that went through a plate so far.
        num_ground_tunnellings: centres that sank a radius into the ground so far, soft ones apart; put
            back upon it.
    """

    def __init__(
        self, params: ParticleParams, ground: Ground, soils: Sequence[LooseSoil], substeps: int
    ) -> None:
        """
        Raises:
            ParticleError: no soil.
        """
        self.params = params
        self.ground = ground
        self.soils = tuple(soils)
        self._materials = ContactMaterials(self.soils, params.nominal_volume)
        self.state = ParticleState(params.capacity)
        self.num_plate_tunnellings = 0
        self.num_ground_tunnellings = 0
        self._tools = ToolSet(substeps)

    # Bodies in and out.

    @abstractmethod
    def add(
        self,
        position: ArrayLike,
        velocity: ArrayLike,
        volume_mm3: ArrayLike,
        soil: ArrayLike = 0,
        moisture: ArrayLike = 0,
        *,
        grow: bool = True,
    ) -> NDArray[np.uint32]:
        """Release soil.

        Args:
            position, velocity: [m], [m/s], map frame, shape (n, 3).
            volume_mm3: bank volume of each [mm^3], whole numbers, shape (n,) or one for all.
            soil: ids, shape (n,) or one for all.
            moisture: [% of saturation], whole numbers; above 100 counts as 100.
            grow: start small and grow, for soil that comes loose among other soil.

        Returns:
            Ids, shape (n,), uint32.

        Raises:
            ParticleError: shapes that do not fit, values that are not finite, coordinates beyond
                1e6 m, speeds above 1000 m/s, volumes or codes out of range, or no room; nothing
                was added.
        """

    @abstractmethod
    def remove(self, ids: ArrayLike) -> None:
        """Take bodies out of the account.

        Raises:
            ParticleError: an id that is not alive or given twice; nothing was removed.
        """

    @abstractmethod
    def freeze(self, ids: ArrayLike) -> None:
        """Hold bodies where they are: landed, not yet answered; still counted and in the way.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """

    @abstractmethod
    def unfreeze(self, ids: ArrayLike) -> None:
        """Let frozen bodies go, from rest.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """

    def settled(self) -> NDArray[np.uint32]:
        """Ids of those that should land, ascending; see `landing.settled_rows`."""
        rows = settled_rows(self.state, self.ground, self._tools.tools, self.params)
        return np.asarray(self.state.particle_id[rows], dtype=np.uint32)

    # Tools.

    @abstractmethod
    def add_tool(
        self, tool_id: int, plates: Sequence[ArrayLike], pose: Pose, *, is_digging: bool = True
    ) -> None:
        """Let a tool touch the soil.

        Args:
            tool_id: the caller's number for it.
            plates: convex planar polygons, each (k, 3) corners [m] in order around, tool frame.
            pose: where it is.
            digs: whether it goes into the ground, which then is no ground to what it holds; False
                for a truck's bed, a bin, a wall.

        Raises:
            ParticleError: the id is taken, or a plate or the pose is not what it should be.
        """

    @abstractmethod
    def remove_tool(self, tool_id: int) -> None:
        """Take a tool away; what lay in it falls.

        Raises:
            ParticleError: no such tool.
        """

    def set_tool_motion(self, tool_id: int, start: Pose, end: Pose) -> None:
        """Move a tool from `start` to `end` in the next step; without this it rests.

        Raises:
            ParticleError: no such tool, no pose, or a turn of 90 degrees or more.
        """
        self._tools[tool_id].move(start, end)

    def tool_wrench(self, tool_id: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [N] of the soil on a tool, and torque about its frame origin [N m].

        Map axes, mean over the last step, shape (3,) each.
        """
        _ = self._tools[tool_id]
        wrench = self._tools.wrench[self._tools.index_by_id[tool_id]]
        return wrench[:3].copy(), wrench[3:].copy()

    def positions_in_tool_frame(self, tool_id: int) -> NDArray[np.float64]:
        """Positions of all bodies [m] in the frame of a tool, in row order, shape (n, 3)."""
        return self._tools[tool_id].to_local_frame(self.state.position)

    # Time.

    @abstractmethod
    def step(self, dt: float) -> None:
        """Advance by `dt` [s].

        Raises:
            ParticleError: dt is not between 0 and 0.1 s.
        """

    @staticmethod
    def _check_step(dt: float) -> None:
        if not 0.0 < dt <= 0.1:
            raise ParticleError(f"dt is {dt} s; give a step above 0 and up to 0.1 s")

    @abstractmethod
    def close(self) -> None:
        """Free what must be freed; the engine is of no use after."""

    # What it is like now.

    def rows_of(self, ids: ArrayLike) -> NDArray[np.intp]:
        """Rows in `store`, good until the next step, add or remove.

        Raises:
            ParticleError: an id that is not alive or given twice.
        """
        return self.state.rows(ids)

    @property
    def free_capacity(self) -> int:
        """How many bodies can still be added."""
        return self.state.capacity - self.state.count

    @property
    def count(self) -> int:
        """Number of bodies, frozen ones included."""
        return self.state.count

    @property
    def total_volume_mm3(self) -> int:
        """Bank volume of all bodies [mm^3], frozen ones included, exact."""
        return self.state.total_volume_mm3

    @property
    def kinetic_energy(self) -> float:
        """Of all bodies [J], that of turning left out."""
        return float(0.5 * (self.state.mass[:, None] * self.state.velocity**2).sum())
