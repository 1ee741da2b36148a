"""Plate contacts against a plain reckoning: who is listed, and the forces plate by plate."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.particle_scenes import LITRE, STEP, engine

from machine_sim.dem import ParticleEngine, Plates
from machine_sim.dem.body_records import BODY_RECORD_SIZE, FORCE_RECORD_SIZE, load_body_records
from machine_sim.dem.contacts.contact_law import contact_parameters
from machine_sim.dem.contacts.plate_block import BLOCK_SIZE
from machine_sim.dem.contacts.plate_contact_list import SEARCH_RADIUS_FACTOR, PlateContactList
from machine_sim.dem.contacts.plate_contacts import PlateContacts
from machine_sim.dem.contacts.plate_forces import plate_forces
from machine_sim.dem.contacts.tunnelling import count_tunnelled
from machine_sim.dem.lifecycle.landing import distance_to_plates

LAW = contact_parameters(0.00125, 6.0, 0.3)
ADHESION_RUPTURE_GAP = 0.06


def rotation(rng: np.random.Generator, most: float = np.pi) -> NDArray[np.float64]:
    """A turn about a random axis by up to an angle [rad]."""
    x, y, z = (axis := rng.normal(size=3)) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = rng.uniform(0.0, most)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def polygon(rng: np.random.Generator) -> NDArray[np.float64]:
    corners = int(rng.integers(3, 9))
    angle = (np.arange(corners) + rng.uniform(0.0, 0.6, corners)) * 2.0 * np.pi / corners
    flat = np.stack([0.5 * np.cos(angle), 0.3 * np.sin(angle), np.zeros(corners)], axis=1)
    return flat @ rotation(rng).T + rng.normal(scale=0.2, size=3)


def scene(seed: int) -> ParticleEngine:
    """Particles about up to three tools that move, far from the map's middle."""
    rng = np.random.default_rng(seed)
    world = engine()
    middle = np.array([200.0, -300.0, 5.0])
    for tool in range(int(rng.integers(1, 4))):
        turn, origin = rotation(rng), middle + rng.normal(scale=0.3, size=3)
        plates = [polygon(rng) for _ in range(rng.integers(1, 6))]
        world.add_tool(tool, plates, (turn, origin))
        to = rotation(rng, 0.4) @ turn, origin + rng.normal(scale=0.03, size=3)
        world.set_tool_motion(tool, (turn, origin), to)
    count = 1200 if seed % 10 == 0 else int(rng.integers(1, 300))
    at = middle + rng.normal(scale=0.4, size=(count, 3))
    volume = rng.integers(LITRE // 20, LITRE, count)
    world.add(at, rng.normal(size=(count, 3)), volume, grow=False)
    state = world.state
    state.angular_velocity[:] = rng.normal(scale=5.0, size=(count, 3))
    state.adhesion[:] = rng.choice([0.0, 500.0], count)
    state.contact_radius[:] = state.radius * rng.choice([0.1, 0.6, 1.0], count)
    world.tools.begin_step(STEP)
    return world


def walls_of(world: ParticleEngine) -> PlateContactList:
    rows = np.arange(world.count)
    walls = PlateContactList()
    walls.update(
        world.state,
        rows,
        world.tools,
        world.tools.tool_frame_positions(rows, world.state.position),
        STEP,
    )
    return walls


def seen_from(world: ParticleEngine, tool: int, row: int) -> tuple[NDArray[np.float64], ...]:
    """Place of a particle in a tool's frame, and its velocity relative to the tool, map axes."""
    tools, state = world.tools, world.state
    pose, twist = tools.path[0, tool], tools.twist[tool]
    arm = state.position[row] - pose[9:]
    speed = state.velocity[row] - twist[:3] - np.cross(twist[3:], arm)
    return arm @ pose[:9].reshape(3, 3), speed


@pytest.mark.parametrize("seed", range(30))
def test_all_plates_within_reach_are_listed_once(seed: int) -> None:
    world = scene(seed)
    tools, state, table = world.tools, world.state, walls_of(world).table
    wanted = []
    for row in range(world.count):
        for plate, tool in enumerate(tools.tool_of_plate):
            place, speed = seen_from(world, tool, row)
            one = Plates(
                *(array[[plate]] for array in tools.plates[:3]), tools.plates.bounds[:, [plate]]
            )
            reach = SEARCH_RADIUS_FACTOR * state.radius[row] + 1.3 * STEP * np.linalg.norm(speed)
            if distance_to_plates(one, *place) <= reach:
                wanted.append((row, plate))
    found = list(zip(table.row[: table.count], table.plate[: table.count], strict=True))
    assert found == wanted
    for row in range(world.count):
        mine = range(table.begin[row], table.end[row])
        assert [k for k in range(table.count) if table.row[k] == row] == list(mine)


def closest(corner: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Point of a polygon's outline closest to one of its plane; None for one inside."""
    edges = np.roll(corner, -1, axis=0) - corner
    ways = point - corner
    outside = edges[:, 0] * ways[:, 1] - edges[:, 1] * ways[:, 0] < 0.0
    if not outside.any():
        return None
    share = np.clip((ways * edges).sum(axis=1) / (edges**2).sum(axis=1), 0.0, 1.0)
    on = corner + share[:, None] * edges
    return on[np.argmin(np.where(outside, np.linalg.norm(on - point, axis=1), np.inf))]


def force_of(
    world: ParticleEngine, row: int, plate: int, side: float, spring: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, NDArray[np.float64]]:
    """Force on a particle, its arm from the centre, rolling limit, and the spring, map axes."""
    tools, state = world.tools, world.state
    tool = int(tools.tool_of_plate[plate])
    pose, twist = tools.path[0, tool], tools.twist[tool]
    to_map = pose[:9].reshape(3, 3)
    place, speed = seen_from(world, tool, row)
    origin, axes = np.split(tools.plates.frame[plate].reshape(4, 3), [1])
    a, b, h = axes @ (place - origin[0])
    radius = max(float(state.contact_radius[row]), 0.5 * float(state.radius[row]))
    outline = closest(
        tools.plates.corner[plate, : tools.plates.num_corners[plate]], np.array([a, b])
    )
    if outline is None:
        normal, overlap = np.array([0.0, 0.0, side]), radius - h * side
    else:
        way = np.array([a - outline[0], b - outline[1], h])
        normal, overlap = way / np.linalg.norm(way), radius - float(np.linalg.norm(way))
    axes = to_map @ axes.T
    normal = axes @ normal
    hold = np.pi * radius**2 * float(state.adhesion[row])
    hold *= np.clip(1.0 + overlap / (ADHESION_RUPTURE_GAP * radius), 0.0, 1.0)
    if overlap <= 0.0:
        return -hold * normal, -radius * normal, 0.0, np.zeros(3)
    stiffness, damping, stiffness_t, damping_t, dt = (float(value) for value in LAW)
    slip = speed - radius * np.cross(state.angular_velocity[row] - twist[3:], normal)
    closing = slip @ normal
    push = max(stiffness * overlap - damping * closing, 0.0)
    slip = slip - closing * normal
    spring = axes @ spring
    spring = spring - (spring @ normal) * normal + slip * dt
    drag = stiffness_t * spring + damping_t * slip
    drag *= min(float(state.tool_friction[row]) * push / max(np.linalg.norm(drag), 1e-30), 1.0)
    mass = float(state.mass[row])
    spring = (drag - damping_t * slip) / stiffness_t
    force = (mass * push - hold) * normal - mass * drag
    limit = mass * push * float(state.tool_rolling_friction[row])
    return force, -radius * normal, limit, axes.T @ spring


@pytest.mark.parametrize("seed", range(30))
def test_forces_are_those_of_a_plain_reckoning(seed: int) -> None:
    world = scene(seed)
    tools, state, walls = world.tools, world.state, walls_of(world)
    rng, table, count = np.random.default_rng(seed), walls.table, world.count
    table.spring[: table.count] = rng.normal(scale=1e-3, size=(table.count, 3))
    table.side[: table.count] = rng.choice([-1.0, 1.0], table.count)
    spring, side = table.spring[: table.count].astype(float), table.side[: table.count].tolist()
    room = count + len(tools.tools)
    body, force_sums = (
        np.zeros((room, BODY_RECORD_SIZE), np.float32),
        np.zeros((room, FORCE_RECORD_SIZE), np.float32),
    )
    load_body_records.for_threads(1)(
        np.arange(count), body, force_sums, state.velocity, state.angular_velocity,
        state.contact_radius,
        state.radius, state.inverse_mass, state.sleep_state,
    )  # fmt: skip
    contacts = PlateContacts()
    blocks = contacts.fill_blocks(state, table, tools, body, force_sums)
    # Some way into the step: particles have moved, and the tools have, too.
    step = seed % (tools.substeps + 1)
    body[:count, :3] = rng.normal(scale=0.01, size=(count, 3))
    plate_forces(blocks, body, force_sums, tools.motion, step, LAW)
    contacts.store_history(table)
    state.position += body[:count, :3]
    tools.path[0] = tools.path[step]
    wanted, springs = np.zeros((count, FORCE_RECORD_SIZE)), np.zeros((table.count, 3))
    wrench = np.zeros((len(tools.tools), 6))
    for c in range(table.count):
        row, plate = int(table.row[c]), int(table.plate[c])
        tool = int(tools.tool_of_plate[plate])
        force, arm, limit, springs[c] = force_of(world, row, plate, side[c], spring[c])
        turning = np.cross(arm, force) / float(state.contact_radius[row])
        wanted[row, :7] += [*force, limit, *turning]
        wanted[row, 12:15] += limit * tools.twist[tool, 3:]
        at = state.position[row] - tools.path[0, tool, 9:] + arm
        wrench[tool] -= [*force, *np.cross(at, force)]
    scale = np.abs(wanted).max(initial=1.0)
    np.testing.assert_allclose(force_sums[:count], wanted, rtol=1e-3, atol=1e-5 * scale)
    np.testing.assert_allclose(tools.wrench, wrench, rtol=1e-3, atol=1e-5 * scale)
    np.testing.assert_allclose(table.spring[: table.count], springs, rtol=1e-3, atol=1e-6)


def test_there_are_contacts_of_every_kind_to_compare() -> None:
    touching = apart = blocks = 0
    for seed in range(30):
        world = scene(seed)
        table = walls_of(world).table
        for c in range(table.count):
            _, _, limit, _ = force_of(
                world, table.row[c], table.plate[c], table.side[c], np.zeros(3)
            )
            touching, apart = touching + (limit > 0.0), apart + (limit == 0.0)
        blocks += (np.bincount(table.plate[: table.count]) > BLOCK_SIZE).sum()
    assert min(touching, apart) > 200
    assert blocks > 0, "a plate with more contacts than a block holds"


@pytest.mark.parametrize("seed", range(10))
def test_a_way_through_a_plate_is_counted_however_long(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = engine(gravity=0.0)
    turn, origin = rotation(rng), np.array([1.0, -2.0, 5.0])
    flat = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    world.add_tool(0, [flat], (turn, origin))
    world.set_tool_motion(0, (turn, origin), (turn, origin + turn @ [0.0, 0.0, 0.02]))
    inside = np.concatenate([rng.uniform(-0.45, 0.45, (50, 2)), np.full((50, 1), 0.05)], axis=1)
    world.add(origin + inside @ turn.T, np.zeros((50, 3)), LITRE, grow=False)
    world.tools.begin_step(STEP)
    table, before = walls_of(world).table, world.state.position.copy()
    ways = np.where(np.arange(50) % 2, 10.0 ** rng.uniform(-1.2, 1, 50), -0.01)
    world.state.position -= ways[:, None] * turn[:, 2]
    counted = count_tunnelled(table, world.state, np.arange(50), world.tools, before)
    assert counted == np.count_nonzero(ways > 0.03)
