"""Common base of the engines of loose soil: bodies with exact volume, tools, and a ground."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.contacts.plate_contacts import MIN_PLATE_RADIUS_FRACTION
from machine_sim.dem.lifecycle.release_validation import ReleaseBatch, validate_release
from machine_sim.dem.lifecycle.settling import freeze_rows, settled_ids
from machine_sim.dem.materials import ContactCoefficients, ContactMaterials
from machine_sim.dem.params import ParticleParams
from machine_sim.dem.state import ParticleError, ParticleState
from machine_sim.dem.tools.pose import ANGULAR, Pose
from machine_sim.dem.tools.rigid_tool import RigidTool
from machine_sim.dem.tools.tool_set import ToolSet
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.kernels import BoxedTable

__all__ = ["ContactCoefficients", "SoilEngine", "read_only"]

_RELEASE_MARGIN = 1.02
"""Distance of released soil from plates over that at which it touches them."""
_MAX_STEP = 0.1
"""Maximum time step [s]."""


class SoilEngine(ABC):
    """Soil as bodies, and the tools and terrain that they touch.

    Bodies have permanent ids. Arrays such as `positions` have one row per body and are read-only
    views of the present state: a step, or a body that is added or removed, may reorder their rows.
    `rows_of` returns the rows of some ids.

    Attributes:
        params: parameters of the physics.
        ground: terrain; its owner calls `Ground.advance`.
        soils: properties of each soil type, by its id.
        swells: swell of each soil type, by its id, shape (soils,).
        state: columns of all bodies, for the modules of `machine_sim.dem` and
            `machine_sim.reference_cubes` and their tests only.
        num_plate_tunnellings: centres that went through a plate so far.
        num_ground_tunnellings: centres that sank a radius into the ground so far and were put back
            on it, except penetration-limited ones.
    """

    def __init__(
        self, params: ParticleParams, ground: Ground, soils: Sequence[LooseSoil], substeps: int
    ) -> None:
        """
        Raises:
            ParticleError: no soil type.
        """
        self.params = params
        self.ground = ground
        self.soils = tuple(soils)
        self.swells: NDArray[np.float64] = np.array([soil.swell for soil in self.soils])
        self.state = ParticleState(params.capacity)
        self.num_plate_tunnellings = 0
        self.num_ground_tunnellings = 0
        self._materials = ContactMaterials(self.soils, params.nominal_volume)
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
        """Release soil as bodies.

        Args:
            position, velocity: [m], [m/s], map frame, shape (n, 3).
            volume_mm3: bank volume of each body [mm^3], whole numbers, shape (n,) or one for all.
            soil: soil type ids, shape (n,) or one for all.
            moisture: [% of saturation], whole numbers; above 100 counts as 100.
            grow: whether they start small and grow, for soil that comes loose inside other soil.

        Returns:
            Ids, ascending, shape (n,), uint32.

        Raises:
            ParticleError: shapes that do not match, values that are not finite, coordinates beyond
                1e6 m, speeds above 1000 m/s, volumes or codes out of range, or no free capacity;
                nothing was added.
        """

    def _validate_release(
        self,
        position: ArrayLike,
        velocity: ArrayLike,
        volume_mm3: ArrayLike,
        soil: ArrayLike,
        moisture: ArrayLike,
    ) -> ReleaseBatch:
        """Return the arguments of `add` as arrays, with soil types that are known."""
        batch = validate_release(position, velocity, volume_mm3, soil, moisture)
        self._materials.validate_soil_ids(batch.soil)
        return batch

    @abstractmethod
    def remove(self, ids: ArrayLike) -> None:
        """Remove bodies with their volume.

        Raises:
            ParticleError: an id that does not exist or is given twice; nothing was removed.
        """

    @abstractmethod
    def freeze(self, ids: ArrayLike) -> None:
        """Fix bodies whose deposit is requested; they still count and have contacts.

        Raises:
            ParticleError: an id that does not exist or is given twice.
        """

    @abstractmethod
    def unfreeze(self, ids: ArrayLike) -> None:
        """Let frozen bodies move again, from rest.

        Raises:
            ParticleError: an id that does not exist or is given twice.
        """

    def _freeze_rows(self, rows: NDArray[np.intp]) -> None:
        freeze_rows(rows, self.state.boxed)

    def _unfreeze_rows(self, rows: NDArray[np.intp]) -> None:
        state = self.state
        state.frozen[rows] = False
        state.inverse_mass[rows] = 1.0 / state.mass[rows]
        state.settle_timer[rows] = 0.0

    def release_clearance(
        self,
        volume_mm3: NDArray[np.int64],
        soil: NDArray[np.uint8],
        moisture: NDArray[np.uint8],
    ) -> float:
        """Return the distance from plates at which released spheres touch none of them [m].

        Args:
            volume_mm3, soil, moisture: of the bodies to release, as of `add`, shape (n,).
        """
        kind = soil.astype(np.int64), np.minimum(moisture, 100)
        radius = float(self._materials.radius(volume_mm3 * 1e-9, *kind).max())
        return _RELEASE_MARGIN * MIN_PLATE_RADIUS_FRACTION * radius

    def settled(self) -> NDArray[np.uint32]:
        """Return the ids of the settled bodies, ascending; see `lifecycle.settling`."""
        return settled_ids(self.state, self.ground, self._tools, self.params)

    # Tools.

    def add_tool(
        self,
        tool_id: int,
        plates: Sequence[ArrayLike],
        pose: Pose,
        *,
        is_digging: bool = True,
        is_milling: bool = False,
    ) -> None:
        """Add a tool that touches the soil.

        Args:
            tool_id: an id that is not in use.
            plates: convex planar polygons, each (k, 3) corners [m] in order around it, tool frame.
            pose: its pose.
            is_digging: whether it enters the ground, which then does not act on the soil in the
                tool; False for the bed of a truck, a bin, a wall.
            is_milling: whether it mills the ground, as a drum does; ahead of another tool that digs
                the ground fails.

        Raises:
            ParticleError: the id is in use, or a plate or the pose is invalid.
        """
        tool = RigidTool(plates, pose, is_digging=is_digging, is_milling=is_milling)
        self._tools.add(tool_id, tool)
        self._include_tool(tool_id, tool, plates)

    @abstractmethod
    def _include_tool(self, tool_id: int, tool: RigidTool, plates: Sequence[ArrayLike]) -> None:
        """Take over a tool that was added, made of plates as given to `add_tool`."""

    @abstractmethod
    def remove_tool(self, tool_id: int) -> None:
        """Remove a tool; the soil in it falls.

        Raises:
            ParticleError: no such tool.
        """

    def set_tool_motion(self, tool_id: int, start: Pose, end: Pose) -> None:
        """Set the motion of a tool in the next step; without this call it is at rest.

        Raises:
            ParticleError: no such tool, an invalid pose, or a rotation by 90 degrees or more.
        """
        self._tools[tool_id].move(start, end)

    def tool_wrench(self, tool_id: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the force [N] of the soil on a tool, and the torque about its frame origin [N m].

        Map axes, mean over the last step, shape (3,) each.

        Raises:
            ParticleError: no such tool.
        """
        wrench = np.array(self.tool_load(tool_id))
        return wrench[:ANGULAR], wrench[ANGULAR:]

    def tool_load(self, tool_id: int) -> list[float]:
        """Return force and torque of `tool_wrench` as six numbers.

        Raises:
            ParticleError: no such tool.
        """
        wrench: list[float] = self._tools.wrench[self._tools.index_of(tool_id)].tolist()
        return wrench

    def positions_in_tool_frame(self, tool_id: int) -> NDArray[np.float64]:
        """Return the centres of all bodies [m] in the frame of a tool, shape (n, 3).

        Raises:
            ParticleError: no such tool.
        """
        return self._tools[tool_id].to_local_frame(self.state.position)

    # Time.

    @abstractmethod
    def step(self, dt: float) -> None:
        """Advance by `dt` [s].

        Raises:
            ParticleError: dt is not between 0 and 0.1 s.
        """

    @staticmethod
    def _validate_step(dt: float) -> None:
        if not 0.0 < dt <= _MAX_STEP:
            raise ParticleError(f"dt is {dt} s; give a step above 0 and up to {_MAX_STEP} s")

    @abstractmethod
    def close(self) -> None:
        """Free external resources; the engine cannot be used afterwards."""

    # The bodies, one row each.

    @property
    def boxed_columns(self) -> BoxedTable:
        """`ParticleColumns` of all bodies, boxed, for kernels that read them."""
        return self.state.boxed

    def rows_of(self, ids: ArrayLike) -> NDArray[np.intp]:
        """Return the rows of some bodies in the arrays below.

        They are valid until the next step, or until a body is added or removed.

        Raises:
            ParticleError: an id that does not exist or is given twice.
        """
        return self.state.rows(ids)

    @property
    def ids(self) -> NDArray[np.uint32]:
        """Ids, shape (n,)."""
        return read_only(self.state.particle_id)

    @property
    def positions(self) -> NDArray[np.float64]:
        """Centres [m], map frame, shape (n, 3)."""
        return read_only(self.state.position)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """Velocities of the centres [m/s], map frame, shape (n, 3)."""
        return read_only(self.state.velocity)

    @property
    def angular_velocities(self) -> NDArray[np.float32]:
        """Angular velocities [rad/s], map axes, shape (n, 3)."""
        return read_only(self.state.angular_velocity)

    @property
    def radii(self) -> NDArray[np.float32]:
        """Radii of full-grown spheres, or half edges of cubes [m], shape (n,)."""
        return read_only(self.state.radius)

    @property
    def masses(self) -> NDArray[np.float32]:
        """Masses [kg], shape (n,)."""
        return read_only(self.state.mass)

    @property
    def volumes_mm3(self) -> NDArray[np.int64]:
        """Bank volumes [mm^3], exact, shape (n,)."""
        return read_only(self.state.volume_mm3)

    @property
    def soil(self) -> NDArray[np.uint8]:
        """Soil type ids, shape (n,)."""
        return read_only(self.state.soil)

    @property
    def moisture(self) -> NDArray[np.uint8]:
        """Moisture [% of saturation], shape (n,)."""
        return read_only(self.state.moisture)

    @property
    def contact_coefficients(self) -> ContactCoefficients:
        """Contact coefficients, shape (n,) each."""
        columns = (getattr(self.state, name) for name in ContactCoefficients._fields)
        return ContactCoefficients(*map(read_only, columns))

    @property
    def is_frozen(self) -> NDArray[np.bool_]:
        """Whether the deposit of a body is requested, shape (n,)."""
        return read_only(self.state.frozen)

    @property
    def frozen_ids(self) -> NDArray[np.uint32]:
        """Ids of the frozen bodies, in row order."""
        return np.asarray(self.state.particle_id[self.state.frozen], dtype=np.uint32)

    # Totals.

    @property
    def count(self) -> int:
        """Number of bodies, frozen ones included."""
        return self.state.count

    @property
    def free_capacity(self) -> int:
        """Number of bodies that can still be added."""
        return self.state.capacity - self.state.count

    @property
    def total_volume_mm3(self) -> int:
        """Bank volume of all bodies [mm^3], frozen ones included, exact."""
        return self.state.total_volume_mm3

    @property
    def kinetic_energy(self) -> float:
        """Translational kinetic energy of all bodies [J]."""
        return float(0.5 * (self.state.mass[:, None] * self.state.velocity**2).sum())


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view
