"""Plate contacts compared with a direct computation, particle by particle and plate by plate."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, engine

from machine_sim.dem import ParticleEngine, Plates
from machine_sim.dem.body_records import (
    BODY_RECORD_SIZE,
    FORCE,
    FORCE_RECORD_SIZE,
    LIMIT_WEIGHTED_ANGULAR_VELOCITY,
    ROLLING_LIMIT,
    TORQUE_OVER_RADIUS,
    load_body_records,
)
from machine_sim.dem.contacts.contact_law import contact_parameters
from machine_sim.dem.contacts.plate_block import BLOCK_SIZE, SCRATCH_SIZE
from machine_sim.dem.contacts.plate_contact_list import (
    PlateCandidates,
    PlateContactList,
    list_plate_contacts,
)
from machine_sim.dem.contacts.plate_contacts import (
    PlateContacts,
    fill_plate_blocks,
    store_plate_history,
)
from machine_sim.dem.contacts.plate_forces import plate_forces
from machine_sim.dem.contacts.tunnelling import count_tunnelled
from machine_sim.dem.lifecycle.settling import distance_to_plates
from machine_sim.dem.tools.near_tools import SEARCH_RADIUS_FACTOR, select_near_tools
from machine_sim.dem.tools.pose import ANGULAR, ORIGIN

CONTACT_PARAMS = contact_parameters(0.00125, 6.0, 0.3)
ADHESION_RUPTURE_GAP = 0.06
MAX_OVERLAP = 0.7
"""Overlap at which a particle is stopped by a plate, in radii."""


def rotation(rng: np.random.Generator, max_angle: float = np.pi) -> NDArray[np.float64]:
    """Return a rotation about a random axis by up to `max_angle` [rad]."""
    x, y, z = (axis := rng.normal(size=3)) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = rng.uniform(0.0, max_angle)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def polygon(rng: np.random.Generator) -> NDArray[np.float64]:
    corners = int(rng.integers(3, 9))
    angle = (np.arange(corners) + rng.uniform(0.0, 0.6, corners)) * 2.0 * np.pi / corners
    flat = np.stack([0.5 * np.cos(angle), 0.3 * np.sin(angle), np.zeros(corners)], axis=1)
    return flat @ rotation(rng).T + rng.normal(scale=0.2, size=3)


def scene(seed: int) -> ParticleEngine:
    """Return an engine with particles around up to three moving tools, far from the map origin."""
    rng = np.random.default_rng(seed)
    world = engine()
    centre = np.array([200.0, -300.0, 5.0])
    for tool in range(int(rng.integers(1, 4))):
        rotation_matrix, origin = rotation(rng), centre + rng.normal(scale=0.3, size=3)
        plates = [polygon(rng) for _ in range(rng.integers(1, 6))]
        world.add_tool(tool, plates, (rotation_matrix, origin))
        end = rotation(rng, 0.4) @ rotation_matrix, origin + rng.normal(scale=0.03, size=3)
        world.set_tool_motion(tool, (rotation_matrix, origin), end)
    count = 1200 if seed % 10 == 0 else int(rng.integers(1, 300))
    at = centre + rng.normal(scale=0.4, size=(count, 3))
    volume = rng.integers(LITRE // 20, LITRE, count)
    world.add(at, rng.normal(size=(count, 3)), volume, grow=False)
    state = world.state
    state.angular_velocity[:] = rng.normal(scale=5.0, size=(count, 3))
    state.adhesion[:] = rng.choice([0.0, 500.0], count)
    state.contact_radius[:] = state.radius * rng.choice([0.1, 0.6, 1.0], count)
    world.tools.begin_step(STEP)
    return world


def list_contacts(world: ParticleEngine) -> PlateContactList:
    rows = np.arange(world.count)
    plate_list, tools = PlateContactList(), world.tools
    particles = world.state.columns
    near_tools = select_near_tools(STEP, rows, particles, tools.motion, 0.0)
    count = -1
    while count < 0:
        count = list_plate_contacts(
            STEP, rows, near_tools, particles, tools.motion, plate_list.table.arrays,
            plate_list.next_table(world.count).arrays,
        )  # fmt: skip
        if count < 0:
            plate_list.enlarge()
    plate_list.accept(count, has_tools=True)
    return plate_list


def relative_motion(world: ParticleEngine, tool: int, row: int) -> tuple[NDArray[np.float64], ...]:
    """Return position in a tool frame [m], and velocity relative to the tool, map axes [m/s]."""
    tools, state = world.tools, world.state
    pose, twist = tools.path[0, tool], tools.twist[tool]
    arm = state.position[row] - pose[ORIGIN:]
    velocity = state.velocity[row] - twist[:ANGULAR] - np.cross(twist[ANGULAR:], arm)
    return arm @ pose[:ORIGIN].reshape(3, 3), velocity


@pytest.mark.parametrize("seed", range(30))
def test_plates_within_reach_are_listed_once(seed: int) -> None:
    world = scene(seed)
    tools, state, table = world.tools, world.state, list_contacts(world).table
    expected = []
    for row in range(world.count):
        for plate, tool in enumerate(tools.tool_of_plate):
            local, velocity = relative_motion(world, tool, row)
            single = Plates(
                *(array[[plate]] for array in tools.plates[:3]), tools.plates.bounds[:, [plate]]
            )
            reach = SEARCH_RADIUS_FACTOR * state.radius[row] + 1.3 * STEP * np.linalg.norm(velocity)
            if distance_to_plates(single, 0, 1, *local) <= reach:
                expected.append((row, plate))
    listed = list(zip(table.row[: table.count], table.plate[: table.count], strict=True))
    assert listed == expected
    for row in range(world.count):
        contacts = range(table.arrays.begin[row], table.arrays.end[row])
        assert [k for k in range(table.count) if table.row[k] == row] == list(contacts)


def closest(corner: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the point of a polygon closest to a point of its plane, None for a point inside."""
    edges = np.roll(corner, -1, axis=0) - corner
    offsets = point - corner
    outside = edges[:, 0] * offsets[:, 1] - edges[:, 1] * offsets[:, 0] < 0.0
    if not outside.any():
        return None
    fraction = np.clip((offsets * edges).sum(axis=1) / (edges**2).sum(axis=1), 0.0, 1.0)
    on = corner + fraction[:, None] * edges
    return on[np.argmin(np.where(outside, np.linalg.norm(on - point, axis=1), np.inf))]


def force_of(
    world: ParticleEngine,
    row: int,
    plate: int,
    side: float,
    spring: NDArray[np.float64],
    other_force: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, NDArray[np.float64]]:
    """Return force [N], lever arm [m], rolling limit [N], map axes, and spring [m], plate axes.

    Args:
        world: a scene.
        row, plate: the contact.
        side: side of the plate that the particle is on.
        spring: elongation of the tangential spring before [m], plate axes.
        other_force: force of other plates on the particle [N], map axes.
    """
    tools, state = world.tools, world.state
    tool = int(tools.tool_of_plate[plate])
    pose, twist = tools.path[0, tool], tools.twist[tool]
    to_map = pose[:ORIGIN].reshape(3, 3)
    local, velocity = relative_motion(world, tool, row)
    origin, axes = np.split(tools.plates.frame[plate].reshape(4, 3), [1])
    a, b, h = axes @ (local - origin[0])
    radius = max(float(state.contact_radius[row]), 0.5 * float(state.radius[row]))
    outline = closest(
        tools.plates.corner[plate, : tools.plates.num_corners[plate]], np.array([a, b])
    )
    if outline is None:
        normal, overlap = np.array([0.0, 0.0, side]), radius - h * side
    else:
        offset = np.array([a - outline[0], b - outline[1], h])
        normal, overlap = offset / np.linalg.norm(offset), radius - float(np.linalg.norm(offset))
    axes = to_map @ axes.T
    normal = axes @ normal
    adhesion = np.pi * radius**2 * float(state.adhesion[row])
    adhesion *= np.clip(1.0 + overlap / (ADHESION_RUPTURE_GAP * radius), 0.0, 1.0)
    mass = float(state.mass[row])
    stiffness, damping, stiffness_t, damping_t, dt = (float(value) for value in CONTACT_PARAMS)
    stop = 0.0
    if outline is None:
        # Over the plate the overlap does not exceed a limit after this substep.
        lowest_velocity = min((overlap - MAX_OVERLAP * radius) / dt, 0.0)
        stop = (lowest_velocity - velocity @ normal) / dt
        stop += (adhesion - other_force @ normal) / mass
    if overlap <= 0.0 and stop <= 0.0:
        return -adhesion * normal, -radius * normal, 0.0, np.zeros(3)
    sliding = velocity - radius * np.cross(state.angular_velocity[row] - twist[ANGULAR:], normal)
    closing = sliding @ normal
    elastic_force = stiffness * overlap - damping * closing if overlap > 0.0 else 0.0
    normal_force = max(elastic_force, stop, 0.0)
    sliding = sliding - closing * normal
    spring = axes @ spring
    spring = spring - (spring @ normal) * normal + sliding * dt
    friction_force = stiffness_t * spring + damping_t * sliding
    limit = float(state.tool_friction[row]) * normal_force
    friction_force *= min(limit / max(np.linalg.norm(friction_force), 1e-30), 1.0)
    spring = (friction_force - damping_t * sliding) / stiffness_t
    force = (mass * normal_force - adhesion) * normal - mass * friction_force
    limit = mass * normal_force * float(state.tool_rolling_friction[row])
    return force, -radius * normal, limit, axes.T @ spring


@njit
def _add_plate_forces(blocks, body, force_sums, tools, step):  # type: ignore[no-untyped-def]
    scratch = np.empty(SCRATCH_SIZE, np.float32)
    plate_forces(blocks, body, force_sums, tools, step, CONTACT_PARAMS, scratch)


@pytest.mark.parametrize("seed", range(30))
def test_forces_are_those_of_the_direct_computation(seed: int) -> None:
    world = scene(seed)
    tools, state, plate_list = world.tools, world.state, list_contacts(world)
    rng, table, count = np.random.default_rng(seed), plate_list.table, world.count
    table.spring[: table.count] = rng.normal(scale=1e-3, size=(table.count, 3))
    table.side[: table.count] = rng.choice([-1.0, 1.0], table.count)
    spring, side = table.spring[: table.count].astype(float), table.side[: table.count].tolist()
    num_rows = count + len(tools.tools)
    body, force_sums = (
        np.zeros((num_rows, BODY_RECORD_SIZE), np.float32),
        np.zeros((num_rows, FORCE_RECORD_SIZE), np.float32),
    )
    load_body_records.for_threads(1)(
        np.arange(count), body, force_sums, state.velocity, state.angular_velocity,
        state.contact_radius, state.radius, state.inverse_mass, state.sleep_state,
    )  # fmt: skip
    contacts = PlateContacts()
    contacts.reserve(table, len(tools.tool_of_plate))
    slot = contacts.memory.slot
    listed = PlateCandidates(table.row[: table.count], table.plate[: table.count])
    blocks = fill_plate_blocks(
        listed, table.spring, table.side, state.columns, tools.motion, body, force_sums,
        contacts.memory.blocks, slot,
    )  # fmt: skip
    # During a step: particles and tools have moved since its start.
    step = seed % (tools.substeps + 1)
    body[:count, :3] = rng.normal(scale=0.01, size=(count, 3))
    _add_plate_forces(blocks, body, force_sums, tools.motion, step)
    store_plate_history(table.count, slot, blocks.block, table.spring, table.side)
    state.position += body[:count, :3]
    tools.path[0] = tools.path[step]
    expected, springs = np.zeros((count, FORCE_RECORD_SIZE)), np.zeros((table.count, 3))
    wrench = np.zeros((len(tools.tools), 6))
    for c in range(table.count):
        row, plate = int(table.row[c]), int(table.plate[c])
        tool = int(tools.tool_of_plate[plate])
        other_force = expected[row, FORCE : FORCE + 3].copy()
        force, arm, limit, springs[c] = force_of(world, row, plate, side[c], spring[c], other_force)
        torque = np.cross(arm, force) / float(state.contact_radius[row])
        expected[row, FORCE : FORCE + 3] += force
        expected[row, ROLLING_LIMIT] += limit
        expected[row, TORQUE_OVER_RADIUS : TORQUE_OVER_RADIUS + 3] += torque
        weighted = slice(LIMIT_WEIGHTED_ANGULAR_VELOCITY, LIMIT_WEIGHTED_ANGULAR_VELOCITY + 3)
        expected[row, weighted] += limit * tools.twist[tool, ANGULAR:]
        at = state.position[row] - tools.path[0, tool, ORIGIN:] + arm
        wrench[tool] -= [*force, *np.cross(at, force)]
    scale = np.abs(expected).max(initial=1.0)
    np.testing.assert_allclose(force_sums[:count], expected, rtol=1e-3, atol=1e-5 * scale)
    np.testing.assert_allclose(tools.wrench, wrench, rtol=1e-3, atol=1e-5 * scale)
    np.testing.assert_allclose(table.spring[: table.count], springs, rtol=1e-3, atol=1e-6)


def test_scenes_contain_contacts_of_every_kind() -> None:
    touching = separate = blocks = 0
    for seed in range(30):
        world = scene(seed)
        table = list_contacts(world).table
        for c in range(table.count):
            _, _, limit, _ = force_of(
                world, table.row[c], table.plate[c], table.side[c], np.zeros(3), np.zeros(3)
            )
            touching, separate = touching + (limit > 0.0), separate + (limit == 0.0)
        blocks += (np.bincount(table.plate[: table.count]) > BLOCK_SIZE).sum()
    assert min(touching, separate) > 200
    assert blocks > 0, "no plate has more contacts than fit into a block"


@pytest.mark.parametrize("seed", range(10))
def test_path_of_any_length_through_a_plate_is_counted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = engine(gravity=0.0)
    rotation_matrix, origin = rotation(rng), np.array([1.0, -2.0, 5.0])
    flat = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    world.add_tool(0, [flat], (rotation_matrix, origin))
    lifted = origin + rotation_matrix @ [0.0, 0.0, 0.02]
    world.set_tool_motion(0, (rotation_matrix, origin), (rotation_matrix, lifted))
    inside = np.concatenate([rng.uniform(-0.45, 0.45, (50, 2)), np.full((50, 1), 0.05)], axis=1)
    world.add(origin + inside @ rotation_matrix.T, np.zeros((50, 3)), LITRE, grow=False)
    world.tools.begin_step(STEP)
    table, before = list_contacts(world).table, world.state.position.copy()
    offsets = np.where(np.arange(50) % 2, 10.0 ** rng.uniform(-1.2, 1, 50), -0.01)
    world.state.position -= offsets[:, None] * rotation_matrix[:, 2]
    counted = count_tunnelled(
        np.arange(50), before, world.state.columns, world.tools.motion, table.arrays
    )
    assert counted == np.count_nonzero(offsets > 0.03)
