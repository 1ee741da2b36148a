"""The ground carries a track on a rigid rail from axle to axle, wherever the shoes are."""

import numba
import numpy as np
import pytest

from machine_sim.machine.tracks.rail_support import add_rail_load
from machine_sim.machine.tracks.rigid_body import BaseFrame
from machine_sim.machine.tracks.terramechanics import soil_patch_under
from machine_sim.machine.tracks.track_state import ContactCoefficients, TrackDimensions

STIFFNESS, DEPTH = 1e6, 0.002
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
FORCE_Z, TORQUE_Y = 2, 4


@numba.njit  # without cache: its key would not contain the code under test
def rail_wrench(
    arms, middles, soft_load, rail_force, base, dimensions, coefficients, soil, on_base, of_ground
):
    """Add the loads of contact points at `arms`, of shoes at `middles`, to both wrenches."""
    for i in range(middles.size):
        add_rail_load(
            (arms[i, 0], arms[i, 1], arms[i, 2]),
            middles[i],
            soft_load,
            rail_force,
            base,
            dimensions,
            coefficients,
            0.05,
            soil,
            on_base,
            of_ground,
        )


@pytest.fixture
def rail(scene):
    """Return a function for the load of one row of contact points on rigid, flat ground.

    The rail is level, `DEPTH` below the ground. The function takes the x of the shoes' middles
    [m], the load of each point on its shoe [N] and the force of each shoe's point on the rail [N];
    it returns the wrench on the base about the middle of the track (force z, torque about y).
    """
    s = scene(tracks="dynamic")
    tracks = s.machine.tracks.spec.tracks
    dimensions = TrackDimensions.of(s.machine.tracks.spec)._replace(base_com=(0.0, 0.0, 0.0))
    sole = tracks.axle_height - tracks.sprocket_radius - 0.5 * tracks.shoe_thickness
    base = BaseFrame((0.0, 0.0, -DEPTH - sole), IDENTITY, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    coefficients = ContactCoefficients(STIFFNESS, 0.0, 0.0, 0.0, 0.8)
    soil = soil_patch_under(s.ground, tracks.shoe_width)

    def wrench_of(middles, *, soft_load=0.0, rail_force=0.0):
        on_base, of_ground = np.zeros(6), np.zeros(6)
        of_points = np.repeat(np.array(middles, dtype=float), 2)
        arms = np.zeros((of_points.size, 3))
        arms[:, 0] = of_points + tracks.sprocket_radius * np.tile([-0.45, 0.45], len(middles))
        arms[:, 2] = sole
        rail_wrench(
            arms, of_points, soft_load, rail_force, base, dimensions, coefficients, soil,
            on_base, of_ground,
        )  # fmt: skip
        np.testing.assert_array_equal(on_base, of_ground)
        return on_base[[FORCE_Z, TORQUE_Y]]

    return wrench_of, tracks


@pytest.mark.parametrize("phase", [0.0, 0.1, 0.25, 0.5, 0.8])
def test_load_of_the_lower_run_does_not_depend_on_where_the_shoes_are(rail, phase):
    wrench_of, tracks = rail
    length, half = tracks.sprocket_radius, 0.5 * tracks.axle_distance
    num_shoes = round(tracks.axle_distance / length)
    middles = -half + length * (phase + np.arange(-1, num_shoes + 1))
    load, torque = wrench_of(middles)
    assert load == pytest.approx(2 * num_shoes * STIFFNESS * DEPTH, rel=1e-6)
    assert abs(torque) < 0.02 * load * half


def test_ground_carries_nothing_past_the_axles(rail):
    wrench_of, tracks = rail
    length, half = tracks.sprocket_radius, 0.5 * tracks.axle_distance
    load, torque = wrench_of([half])  # half of this shoe is before the axle
    assert load == pytest.approx(STIFFNESS * DEPTH)
    assert half - 0.5 * length <= -torque / load <= half
    load, torque = wrench_of([half - 0.1 * length])  # its outer contact point is past the axle
    assert load == pytest.approx(1.2 * STIFFNESS * DEPTH)
    assert -torque == pytest.approx(STIFFNESS * DEPTH * (half - 0.55 * length + 0.2 * half))
    assert wrench_of([half + 0.6 * length])[0] == 0.0


def test_shoe_that_carries_more_relieves_the_base_by_what_it_presses_on_the_rail(rail):
    wrench_of, _ = rail
    spring = STIFFNESS * DEPTH
    assert wrench_of([0.0], soft_load=0.4 * spring)[0] == pytest.approx(2 * 0.6 * spring)
    more = {"soft_load": 1.5 * spring}
    assert wrench_of([0.0], **more)[0] == 0.0
    assert wrench_of([0.0], **more, rail_force=0.2 * spring)[0] == pytest.approx(-0.4 * spring)
    assert wrench_of([0.0], **more, rail_force=9.0 * spring)[0] == pytest.approx(-1.0 * spring)
