"""Forces of plates on particles, block by block: gather, evaluate in plate axes, scatter.

A particle over a plate is pushed along the plate's normal, to the side that its contact stores.
Beside the plate it is pushed away from the closest point of the outline. All of this is done in
plate axes (a, b, h), see `tools.plates`; the spring turns with the plate.
"""

from __future__ import annotations

import numpy as np

from machine_sim.dem.body_records import FORCE, INVERSE_MASS
from machine_sim.dem.contacts import plate_block as plate
from machine_sim.dem.contacts.contact_law import contact_force, contact_force_and_torque
from machine_sim.dem.contacts.simd import (
    GROUP_SIZE,
    VECTOR_SIZE,
    gather_relative_motion,
    round_up,
    scatter_forces,
)
from machine_sim.dem.tools.plates import FRAME_N, FRAME_U, FRAME_V
from machine_sim.dem.tools.pose import ANGULAR, LINEAR, ORIGIN, XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ
from machine_sim.dem.vec3 import add, cross, dot, load_row, scale, subtract
from msg_bridge.kernels import helper

__all__ = ["plate_forces"]

_ADHESION_RUPTURE_GAP = np.float32(0.06)
"""Gap at which the adhesion between a particle and a plate breaks, in radii."""
_MAX_OVERLAP = np.float32(0.7)
"""Overlap with a plate at which a particle is stopped in one substep, in radii."""
_OVER_PLATE = np.float32(1e30)
"""Squared distance from the outline of a centre whose closest point is not on the outline."""
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TINY = np.float32(1e-20)


@helper(forceinline=True)
def plate_forces(blocks, body, force_sums, tools, step, contact_params, scratch):  # type: ignore[no-untyped-def]
    """Add the forces of plates to the sums of particles, and their reaction to the tools' wrenches.

    Args:
        blocks: `PlateContactBlocks`; springs and sides are updated.
        body, force_sums: see `body_records`.
        tools: `ToolMotion`; the wrench is updated.
        step: number of the substep.
        contact_params: `ContactParameters`.
        scratch: a scratch block, see `plate_block`.
    """
    start, pose = tools.path[0], tools.path[step]
    for n in range(blocks.plate.size):
        k, begin, block = blocks.plate[n], n * plate.BLOCK_SIZE, blocks.block[n]
        t = tools.tool_of_plate[k]
        num_slots = round_up(blocks.size[n], GROUP_SIZE)
        num_evaluated = round_up(num_slots, VECTOR_SIZE)
        for s in range(0, num_slots, GROUP_SIZE):
            gather_relative_motion(
                body, blocks.tool_row, blocks.row, begin + s, scratch, plate.BLOCK_SIZE, s
            )
        axes = _plate_axes(tools.plates.frame, k, pose[t])
        start_axes = _plate_axes(tools.plates.frame, k, start[t])
        axes_change = (
            _to_float32(subtract(axes[0], start_axes[0])),
            _to_float32(subtract(axes[1], start_axes[1])),
            _to_float32(subtract(axes[2], start_axes[2])),
        )
        axes32 = _to_float32(axes[0]), _to_float32(axes[1]), _to_float32(axes[2])
        origin_shift = subtract(load_row(pose, t, ORIGIN), load_row(start, t, ORIGIN))
        _transform_to_plate_axes(
            num_evaluated, block, scratch, axes32, axes_change, _to_float32(origin_shift),
            _to_float32(load_row(tools.twist, t, LINEAR)),
            _to_float32(load_row(tools.twist, t, ANGULAR)),
        )  # fmt: skip
        _gather_accelerations(num_slots, blocks.row, begin, body, force_sums, axes32[2], scratch)
        _find_closest_points(
            num_evaluated, scratch, tools.plates.corner[k], tools.plates.num_corners[k]
        )
        _evaluate_contacts(num_evaluated, block, scratch, contact_params)
        _transform_to_map_axes(num_evaluated, block, scratch, axes32)
        for s in range(0, num_slots, GROUP_SIZE):
            scatter_forces(
                body, force_sums, blocks.tool_row, blocks.row, begin + s, scratch,
                plate.BLOCK_SIZE, s,
            )  # fmt: skip
        for axis in range(3):
            force, torque = 0.0, 0.0
            for s in range(blocks.size[n]):
                force += scratch[plate.FORCE + axis * plate.BLOCK_SIZE + s]
                torque += scratch[plate.TOOL_TORQUE + axis * plate.BLOCK_SIZE + s]
            tools.wrench[t, LINEAR + axis] -= force
            tools.wrench[t, ANGULAR + axis] -= torque


@helper(forceinline=True)
def _plate_axes(frame, k, pose):  # type: ignore[no-untyped-def]
    """Return the axes u, v and n of plate `k`, map axes, three components each."""
    rows = (
        (pose[XX], pose[XY], pose[XZ]),
        (pose[YX], pose[YY], pose[YZ]),
        (pose[ZX], pose[ZY], pose[ZZ]),
    )
    u, v, n = load_row(frame, k, FRAME_U), load_row(frame, k, FRAME_V), load_row(frame, k, FRAME_N)
    return _in_axes(rows, u), _in_axes(rows, v), _in_axes(rows, n)


@helper(forceinline=True)
def _to_float32(a):  # type: ignore[no-untyped-def]
    return np.float32(a[0]), np.float32(a[1]), np.float32(a[2])


@helper(forceinline=True)
def _in_axes(axes, a):  # type: ignore[no-untyped-def]
    """Return the components of a vector along three axes."""
    return dot(axes[0], a), dot(axes[1], a), dot(axes[2], a)


@helper(forceinline=True)
def _from_axes(axes, a):  # type: ignore[no-untyped-def]
    """Return the vector that has the given components along three axes."""
    return add(add(scale(axes[0], a[0]), scale(axes[1], a[1])), scale(axes[2], a[2]))


@helper
def _transform_to_plate_axes(  # type: ignore[no-untyped-def]
    num_slots, block, scratch, axes, axes_change, origin_shift, tool_velocity, tool_angular_velocity
):
    """Replace the gathered motion by position and motion relative to the plate, in plate axes.

    Args:
        num_slots: number of slots to transform, from the first one on.
        block: block of plate contacts, see `plate_block`.
        scratch: scratch block; the gathered motion in it is replaced.
        axes: u, v and n of the plate now, map axes, float32.
        axes_change: change of `axes` since the start of the step: small enough for float32.
        origin_shift: displacement of the tool's origin since the start of the step [m].
        tool_velocity, tool_angular_velocity: twist of the tool, map axes [m/s], [rad/s].
    """
    for s in range(np.uint64(num_slots)):
        # Plate axes R at the start and R' now, lever arm r: R'(r + d) = R r + R' d + (R' - R) r.
        shift = subtract(plate.load(scratch, plate.RELATIVE_DISPLACEMENT, s), origin_shift)
        arm = plate.load(block, plate.LEVER_ARM, s)
        centre = plate.load(block, plate.CENTRE, s)
        position = add(add(centre, _in_axes(axes, shift)), _in_axes(axes_change, arm))
        plate.store(scratch, plate.POSITION, s, position)
        arm = add(arm, shift)
        plate.store(scratch, plate.CURRENT_LEVER_ARM, s, arm)
        velocity = plate.load(scratch, plate.RELATIVE_VELOCITY, s)
        velocity = subtract(subtract(velocity, tool_velocity), cross(tool_angular_velocity, arm))
        plate.store(scratch, plate.RELATIVE_VELOCITY, s, _in_axes(axes, velocity))
        surface_velocity = subtract(
            scale(plate.load(scratch, plate.SURFACE_VELOCITY, s), block[plate.RADIUS_RATIO + s]),
            scale(tool_angular_velocity, block[plate.RADIUS + s]),
        )
        plate.store(scratch, plate.SURFACE_VELOCITY, s, _in_axes(axes, surface_velocity))


@helper
def _gather_accelerations(num_slots, row, begin, body, force_sums, normal, scratch):  # type: ignore[no-untyped-def]
    """Write the accelerations by the forces summed so far along the normal of the plate.

    Args:
        num_slots: number of slots to fill, from the first one on.
        row: row of the particle of each contact, uint32.
        begin: contact of the first slot.
        body, force_sums: see `body_records`.
        normal: normal of the plate, map axes, float32.
        scratch: scratch block, see `plate_block`.
    """
    for s in range(num_slots):
        i = row[begin + s]
        acceleration = dot(load_row(force_sums, i, FORCE), normal) * body[i, INVERSE_MASS]
        scratch[plate.ACCELERATION + s] = acceleration


@helper
def _find_closest_points(num_slots, scratch, corner, num_corners):  # type: ignore[no-untyped-def]
    """Find the points of the plate that are closest to the centres.

    The same as `closest_in_polygon`, but edge by edge for all contacts: the closest point lies on
    an edge that the centre is outside of.

    Args:
        num_slots: number of slots to evaluate, from the first one on.
        scratch: scratch block, see `plate_block`; the results are written to it.
        corner, num_corners: corners of the plate and their number, see `Plates`.
    """
    for s in range(np.uint64(num_slots)):
        scratch[plate.OUTLINE_DISTANCE2 + s] = _OVER_PLATE
        scratch[plate.OUTLINE_OFFSET_A + s] = _ZERO
        scratch[plate.OUTLINE_OFFSET_B + s] = _ZERO
    for e in range(num_corners):
        f = e + 1 if e + 1 < num_corners else 0
        corner_a, corner_b = np.float32(corner[e, 0]), np.float32(corner[e, 1])
        edge_a = np.float32(corner[f, 0] - corner[e, 0])
        edge_b = np.float32(corner[f, 1] - corner[e, 1])
        inverse_length2 = _ONE / (edge_a * edge_a + edge_b * edge_b)
        for s in range(np.uint64(num_slots)):
            a = scratch[plate.POSITION_A + s] - corner_a
            b = scratch[plate.POSITION_B + s] - corner_b
            fraction = min(max((a * edge_a + b * edge_b) * inverse_length2, _ZERO), _ONE)
            da, db = a - fraction * edge_a, b - fraction * edge_b
            distance2 = da * da + db * db
            is_closer = (edge_a * b - edge_b * a < _ZERO) & (
                distance2 < scratch[plate.OUTLINE_DISTANCE2 + s]
            )
            scratch[plate.OUTLINE_DISTANCE2 + s] = (
                distance2 if is_closer else scratch[plate.OUTLINE_DISTANCE2 + s]
            )
            scratch[plate.OUTLINE_OFFSET_A + s] = (
                da if is_closer else scratch[plate.OUTLINE_OFFSET_A + s]
            )
            scratch[plate.OUTLINE_OFFSET_B + s] = (
                db if is_closer else scratch[plate.OUTLINE_OFFSET_B + s]
            )


@helper
def _evaluate_contacts(num_slots, block, scratch, contact_params):  # type: ignore[no-untyped-def]
    """Replace position and motion by forces, in plate axes; update springs and sides.

    The spring alone would let a small particle pass a fast plate, or one that others push. A
    particle over the plate is therefore stopped within the substep in which its overlap would
    exceed `_MAX_OVERLAP`, at any speed and with any forces of other particles on it.
    """
    inverse_substep = _ONE / contact_params.substep
    inverse_stiffness = _ONE / contact_params.normal_stiffness
    for s in range(np.uint64(num_slots)):
        h, radius = scratch[plate.POSITION_H + s], block[plate.RADIUS + s]
        is_over_plate = scratch[plate.OUTLINE_DISTANCE2 + s] == _OVER_PLATE
        # The side can change only beside the plate.
        side = block[plate.SIDE + s] if is_over_plate else (_ONE if h >= _ZERO else -_ONE)
        offset = scratch[plate.OUTLINE_OFFSET_A + s], scratch[plate.OUTLINE_OFFSET_B + s], h
        distance = np.sqrt(dot(offset, offset) + _TINY)
        inverse = _ONE / distance
        normal = (
            offset[0] * inverse,
            offset[1] * inverse,
            side if is_over_plate else h * inverse,
        )
        overlap = radius - (h * side if is_over_plate else distance)
        # The adhesion decreases linearly over a small gap.
        cohesion_force = block[plate.ADHESION_FORCE + s] * min(
            max(_ONE + overlap / (_ADHESION_RUPTURE_GAP * radius), _ZERO), _ONE
        )
        velocity = plate.load(scratch, plate.RELATIVE_VELOCITY, s)
        # Contact acceleration that stops the particle in time.
        normal_velocity = dot(velocity, normal)
        lowest_velocity = min((overlap - _MAX_OVERLAP * radius) * inverse_substep, _ZERO)
        stop = (
            (lowest_velocity - normal_velocity) * inverse_substep
            + cohesion_force / max(block[plate.MASS + s], _TINY)
            - side * scratch[plate.ACCELERATION + s]
        )
        is_stopped = is_over_plate & (stop > _ZERO)
        touches = _ONE if (overlap > _ZERO) | is_stopped else _ZERO
        # Raise the overlap to the one whose normal force is that; without contact it is negative.
        stop_overlap = (stop + contact_params.normal_damping * normal_velocity) * inverse_stiffness
        raised_overlap = max(overlap, stop_overlap) if overlap > _ZERO else stop_overlap
        overlap = raised_overlap if is_stopped else overlap
        # The contact point lies one radius from the centre and moves with the rotation.
        contact_velocity = subtract(
            velocity, cross(plate.load(scratch, plate.SURFACE_VELOCITY, s), normal)
        )
        normal_force, friction_force, spring = contact_force(
            contact_params, block[plate.FRICTION + s], overlap, normal, contact_velocity,
            plate.load(block, plate.TANGENTIAL_SPRING, s),
        )  # fmt: skip
        plate.store(block, plate.TANGENTIAL_SPRING, s, scale(spring, touches))
        block[plate.SIDE + s] = side
        force, torque_over_radius, normal_force = contact_force_and_torque(
            block[plate.MASS + s] * touches, cohesion_force, normal_force, friction_force, normal
        )
        plate.store(scratch, plate.FORCE, s, force)
        plate.store(scratch, plate.TORQUE_OVER_RADIUS, s, torque_over_radius)
        scratch[plate.ROLLING_LIMIT + s] = normal_force * block[plate.ROLLING_FRICTION + s]


@helper
def _transform_to_map_axes(num_slots, block, scratch, axes):  # type: ignore[no-untyped-def]
    """Transform forces and torques from plate axes to map axes; compute the torques on the tool."""
    for s in range(np.uint64(num_slots)):
        force = _from_axes(axes, plate.load(scratch, plate.FORCE, s))
        torque = _from_axes(axes, plate.load(scratch, plate.TORQUE_OVER_RADIUS, s))
        plate.store(scratch, plate.FORCE, s, force)
        plate.store(
            scratch, plate.TORQUE_OVER_RADIUS, s, scale(torque, block[plate.RADIUS_RATIO + s])
        )
        arm = plate.load(scratch, plate.CURRENT_LEVER_ARM, s)
        tool_torque = add(cross(arm, force), scale(torque, block[plate.RADIUS + s]))
        plate.store(scratch, plate.TOOL_TORQUE, s, tool_torque)
