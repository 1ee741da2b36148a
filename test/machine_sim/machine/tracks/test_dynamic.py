"""Dynamic tracks: driving, turning, climbing, stopping, holding, and chains that come off."""

import hashlib
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from machine_sim.machine import MachineError, TrackedMachine

from ..conftest import DT

ROOT = Path(__file__).resolve().parents[4]
STILL = [0.0] * 4


def rough(seed, height=0.15):
    """Return rolling ground of 14 random waves, z(x, y) [m]."""
    rng = np.random.default_rng(seed)
    waves = [(*rng.normal(0.0, 0.6, 2), rng.uniform(0.0, 2.0 * math.pi)) for _ in range(14)]

    def surface(x, y):
        waves_at_point = (
            np.sin(kx * x + ky * y + phase) / (1.0 + 1.2 * math.hypot(kx, ky))
            for kx, ky, phase in waves
        )
        return 0.35 * height * sum(waves_at_point)

    return surface


def heading(machine):
    """Return the yaw of the base [rad]."""
    x, y, z, w = machine.base_pose[1]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def drive(s, speeds, seconds):
    s.machine.command(STILL, speeds)
    s.run(seconds)


@pytest.mark.parametrize(("speed", "start"), [(0.8, -8.0), (-0.8, 8.0)])
def test_machine_drives_at_the_commanded_speed(scene, speed, start):
    s = scene(tracks="dynamic", position=(start, 0.0))
    drive(s, [speed, speed], 2.0)
    start = s.position
    s.run(4.0)
    displacement = s.position - start
    assert displacement[0] / 4.0 == pytest.approx(math.copysign(0.803, speed), rel=0.02)
    assert abs(displacement[1]) < 0.02
    np.testing.assert_allclose(s.machine.tracks.speed, speed, atol=0.1)


def test_opposed_tracks_pivot_on_the_spot(scene):
    s = scene(tracks="dynamic")
    drive(s, [-0.5, 0.5], 2.0)
    start, turned = s.position, 0.0
    for _ in range(10):
        before = heading(s.machine)
        s.run(0.4)
        turned += (heading(s.machine) - before + math.pi) % (2.0 * math.pi) - math.pi
    assert turned / 4.0 == pytest.approx(0.30, abs=0.03)  # 0.42 without slip
    assert np.linalg.norm(s.position - start) < 0.5
    assert s.machine.tilt < 0.03


def test_machine_stops_within_15_cm_and_does_not_creep(scene):
    s = scene(tracks="dynamic", position=(-4.0, 0.0))
    drive(s, [0.8, 0.8], 3.0)
    start = s.position
    s.machine.command(STILL, [0.0, 0.0])
    stopping = []
    for _ in range(200):
        s.step()
        stopping.append((s.position - start)[0])
    assert max(stopping) <= 0.15
    s.run(3.0)
    start = s.position
    s.run(5.0)
    assert np.linalg.norm(s.position - start) < 0.003


@pytest.mark.parametrize("slope", [15, 25])
def test_machine_climbs_and_holds_on_a_slope(scene, slope):
    s = scene(tracks="dynamic", slope_deg=slope, position=(-4.0, 0.0))
    s.run(1.0)
    start = s.position
    drive(s, [0.5, 0.5], 4.0)
    uphill = [math.cos(math.radians(slope)), 0.0, math.sin(math.radians(slope))]
    climbed = (s.position - start) @ uphill
    assert climbed > 0.75 * 0.5 * 4.0
    drive(s, [0.0, 0.0], 2.0)
    start = s.position
    s.run(10.0)
    assert np.linalg.norm(s.position - start) < 0.02


def test_machine_slides_on_a_slope_steeper_than_friction(scene):
    """mu = 0.8 holds to 38.7 degrees."""
    s = scene(tracks="dynamic", slope_deg=42)
    s.run(2.0)
    assert s.position[0] < -0.3


def test_arm_holds_while_the_machine_drives_over_a_sill(scene):
    """A rail as stiff as the ground would hit the sill: the boom would move by 2 mrad."""

    def sill(x, y):
        return np.where(np.abs(x - 1.0) < 0.25, 0.15, 0.0)

    s = scene(sill, tracks="dynamic", position=(-3.0, 0.0))
    s.run(1.0)
    home, motion = np.array(s.machine.joint_positions), 0.0
    s.machine.command(STILL, [0.8, 0.8])
    for _ in range(1200):
        s.step()
        motion = max(motion, np.abs(np.array(s.machine.joint_positions) - home).max())
    assert s.position[0] > 1.5  # the axles are past it
    assert motion < 5e-4


def test_chains_stay_on_when_driven_from_the_first_step(scene, spec):
    top = spec.tracks.max_speed
    s = scene(tracks="dynamic", position=(-8.0, 0.0))
    drive(s, [9.0, 9.0], 4.0)
    assert s.machine.base_velocity[0][0] == pytest.approx(top, rel=0.15)


@pytest.mark.parametrize("dt", [0.002, 0.01])
def test_speed_does_not_depend_on_the_time_step(scene, dt):
    s = scene(tracks="dynamic", position=(-4.0, 0.0), dt=dt)
    drive(s, [0.8, 0.8], 2.0)
    start = s.position
    s.run(2.0)
    assert (s.position - start)[0] / 2.0 == pytest.approx(0.8, rel=0.06)


def test_shoes_carry_the_weight(scene, spec):
    s = scene(tracks="dynamic")
    s.run(5.0)
    tracks = s.machine.tracks
    weight = spec.mass * 9.81
    assert tracks.shoe_loads.sum() == pytest.approx(weight, rel=0.05)
    assert tracks.wrench[2] == pytest.approx(weight, rel=0.05)
    assert 16 <= np.count_nonzero(tracks.shoe_loads) <= 24  # 9 shoes of each side lie flat


def test_shoes_circulate_with_closed_hinges_on_their_path(scene):
    s = scene(tracks="dynamic", position=(-4.0, 0.0))
    shape = s.machine.spec.tracks
    first = s.machine.tracks.shoe_poses[:, 0].copy()
    drive(s, [0.8, 0.5], 5.0)
    tracks = s.machine.tracks
    assert tracks.travel == pytest.approx([3.9, 2.4], abs=0.3)
    for side in range(2):
        x, z, pitch = tracks.shoe_poses[side].T
        ahead = 0.5 * shape.sprocket_radius * np.column_stack([np.cos(pitch), -np.sin(pitch)])
        middles = np.column_stack([x, z])
        gaps = np.linalg.norm(middles + ahead - np.roll(middles - ahead, -1, axis=0), axis=1)
        assert gaps.max() < 0.03
        over = np.maximum(np.abs(x) - 0.5 * shape.axle_distance, 0.0)
        off = np.hypot(over, z - shape.axle_height) - shape.sprocket_radius
        assert np.abs(off).max() < 0.1
        # When driving forward, a shoe moves from the lower run around the rear sprocket.
        assert np.linalg.norm(tracks.shoe_poses[side, 0, :2] - first[side, :2]) > 1.0


def test_left_track_is_first(scene):
    s = scene(tracks="dynamic")
    drive(s, [0.0, 0.5], 2.0)
    assert s.machine.base_velocity[1][2] > 0.1  # a faster right track turns left


def test_machine_follows_ground_that_is_lowered(scene):
    s = scene(tracks="dynamic")
    s.run(2.0)
    before = s.position[2]
    s.lower_ground(0.1)
    s.run(2.0)
    assert s.position[2] - before == pytest.approx(-0.1, abs=0.01)


SHOES_PER_SIDE = 24


def move_shoes(s, shoes, displacement):
    """Move shoes of the right track; `displacement` maps poses in the base frame to [m].

    Args:
        s: scene.
        shoes: indices of the shoes.
        displacement: displacement in the map frame for x, z of a shoe in the base frame.
    """
    poses = s.machine.tracks.shoe_poses[1]
    for k in shoes:
        shoe = s.machine.body + 1 + SHOES_PER_SIDE + k
        position, quaternion = s.client.getBasePositionAndOrientation(shoe)
        x, z, _ = poses[k]
        s.client.resetBasePositionAndOrientation(
            shoe, np.add(position, displacement(x, z)).tolist(), quaternion
        )


def one_up(x, z):
    return [0.0, 0.0, 0.5]


def sideways(x, z):
    return [0.0, 0.3, 0.0]


def below_rail(x, z):
    """Move a shoe between the axles and below them, so that the wheels are bare."""
    return [-0.3 * x, 0.0, -max(z, 0.0)]


@pytest.mark.parametrize(
    ("shoes", "displacement"),
    [((12,), one_up), (range(SHOES_PER_SIDE), sideways), (range(SHOES_PER_SIDE), below_rail)],
)
def test_chain_that_comes_off_is_put_back_while_the_machine_drives_on(scene, shoes, displacement):
    s = scene(tracks="dynamic", position=(-4.0, 0.0))
    drive(s, [0.8, 0.8], 3.0)
    start, speeds = s.position, []
    move_shoes(s, shoes, displacement)
    for _ in range(400):
        s.step()
        speeds.append(s.machine.base_velocity[0][0])
    assert s.machine.tracks.num_reseats == [0, 1]
    assert (s.position - start)[0] == pytest.approx(1.6, abs=0.1)
    assert min(speeds) > 0.7


def test_chain_that_was_put_back_is_tightened_within_a_second(scene):
    s = scene(tracks="dynamic")
    s.run(1.5)
    idler = s.client.getNumJoints(s.machine.body) - 1  # of the right side
    assert s.client.getJointInfo(s.machine.body, idler)[1] == b"idler_right"
    move_shoes(s, (12,), one_up)
    s.run(0.1)
    assert s.machine.tracks.num_reseats == [0, 1]
    assert s.client.getJointState(s.machine.body, idler)[0] < 0.015  # it moves at 0.1 m/s
    s.run(1.2)
    assert s.client.getJointState(s.machine.body, idler)[0] == pytest.approx(0.02, abs=0.002)


def test_chain_that_hangs_off_the_rail_has_not_come_off(scene):
    """Between the axles the chain sags by up to 0.3 m when the machine climbs backward."""
    s = scene(tracks="dynamic")
    s.run(0.5)
    x, z, _ = s.machine.tracks.shoe_poses[1].T
    lower = np.flatnonzero((z < 0.1) & (np.abs(x) < 0.5))
    assert lower.size == 3
    move_shoes(s, lower, lambda x, z: [0.0, 0.0, -0.4])
    s.run(2.0)
    assert s.machine.tracks.num_reseats == [0, 0]
    start = s.position
    drive(s, [0.8, 0.8], 3.0)
    assert (s.position - start)[0] == pytest.approx(2.3, abs=0.2)


def test_motion_that_is_not_finite_is_an_error(scene):
    s = scene(tracks="dynamic")
    s.client.resetBaseVelocity(s.machine.body + 1, [math.nan, 0.0, 0.0], [0.0, 0.0, 0.0])
    with pytest.raises(MachineError, match="not finite"):
        s.run(0.1)


def test_two_machines_share_a_client(scene, spec):
    s = scene(tracks="dynamic")
    other = TrackedMachine(spec, s.client, s.ground, (0.0, 9.0), math.pi, "dynamic")
    s.machine.command(STILL, [0.5, 0.5])
    start = other.base_pose[0]
    for _ in range(300):
        s.machine.before_step(DT)
        other.before_step(DT)
        s.client.stepSimulation()
        s.machine.after_step()
        other.after_step()
    assert s.position[0] > 0.3
    assert np.linalg.norm(other.base_pose[0] - start) < 0.03


def random_drive(s, rng, seconds):
    """Drive at random near the middle of the map; return a hash of the states."""
    digest, time = hashlib.sha256(), 0.0
    while time < seconds:
        speeds = [(0.8, 0.8), (-0.8, -0.8), (0.6, 0.2), (-0.4, 0.4), (0.0, 0.0)][rng.integers(5)]
        if np.linalg.norm(s.position[:2]) > 7.0:
            outward = s.position[:2] @ [math.cos(heading(s.machine)), math.sin(heading(s.machine))]
            speeds = (-0.8, -0.8) if outward > 0.0 else (0.8, 0.8)
        duration = rng.uniform(1.0, 4.0)
        drive(s, speeds, duration)
        time += duration
        for array in (*s.machine.base_pose, s.machine.tracks.shoe_poses, s.machine.tracks.wrench):
            digest.update(array.tobytes())
    return digest.hexdigest()


def test_equal_commands_give_bit_identical_states(scene):
    hashes = [
        random_drive(scene(rough(3), tracks="dynamic"), np.random.default_rng(4), 4.0)
        for _ in range(2)
    ]
    assert hashes[0] == hashes[1]


ANOTHER_PROCESS = """
import sys
import numpy as np
from machine_sim.machine import load_machine_spec
sys.path.append("test/machine_sim")
from machine.tracks import test_dynamic as t
from machine.conftest import MACHINE_FILE, Scene
scene = Scene(load_machine_spec(MACHINE_FILE), t.rough(3), tracks="dynamic")
print(t.random_drive(scene, np.random.default_rng(4), 4.0))
"""


def test_equal_commands_give_bit_identical_states_in_another_process(scene):
    here = random_drive(scene(rough(3), tracks="dynamic"), np.random.default_rng(4), 4.0)
    command = [sys.executable, "-c", ANOTHER_PROCESS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == here


@pytest.mark.slow
@pytest.mark.independent
@pytest.mark.parametrize("seed", [1, 2])
def test_chains_stay_on_while_driving_about_on_rough_ground(scene, seed):
    s = scene(rough(seed), tracks="dynamic")
    random_drive(s, np.random.default_rng(seed), 60.0)
    assert not s.machine.overturned
    before = s.position
    speed = -0.8 if before[0] * math.cos(heading(s.machine)) > 0.0 else 0.8
    drive(s, [speed, speed], 2.0)
    assert np.linalg.norm(s.position - before) > 1.2  # it is not jammed either


@pytest.mark.slow
@pytest.mark.independent
def test_standing_machine_does_not_creep(scene):
    s = scene(tracks="dynamic")
    drive(s, [0.5, 0.4], 2.0)
    drive(s, [0.0, 0.0], 15.0)
    start = s.position
    s.run(60.0)
    assert np.linalg.norm(s.position - start) < 1e-3


def test_shoes_touch_only_the_wheels_of_their_own_side(scene):
    s = scene(tracks="dynamic", position=(-4.0, 0.0))
    drive(s, [0.5, -0.3], 1.0)
    first = s.machine.body + 1
    links = {
        s.client.getJointInfo(s.machine.body, i)[1].decode(): i
        for i in range(s.client.getNumJoints(s.machine.body))
    }
    contacts = set()
    for contact in s.client.getContactPoints():
        bodies = {contact[1]: contact[3], contact[2]: contact[4]}
        assert set(bodies) - {s.machine.body}, "the machine collides with itself"
        assert s.machine.body in bodies, "shoes collide with each other"
        shoe = next(body for body in bodies if body != s.machine.body)
        side = "left" if shoe - first < 24 else "right"
        assert bodies[s.machine.body] in (links[f"sprocket_{side}"], links[f"idler_{side}"])
        contacts.add((side, bodies[s.machine.body]))
    assert len(contacts) == 4
