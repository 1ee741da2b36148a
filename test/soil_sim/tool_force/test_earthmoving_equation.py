"""Earthmoving equation: limit cases, equilibrium of the wedge, scaling, invalid arguments."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from soil_sim.errors import SoilError
from soil_sim.tool_force import (
    BladeForce,
    WedgeFactors,
    blade_force,
    compute_blade_force,
    wedge_factors,
)
from soil_sim.tool_force.earthmoving_equation import MAX_ANGLE_SUM, MAX_FRICTION, MIN_RAKE

LOAM = {
    "gamma": 16e3,
    "phi": math.radians(35.0),
    "delta": math.radians(23.0),
    "cohesion": 10e3,
    "adhesion": 2e3,
}
BUCKET = {"width": 1.2, "depth": 0.2, "rake": math.radians(60.0)}

rakes = st.floats(10.0, 170.0).map(math.radians)
frictions = st.floats(0.0, 60.0).map(math.radians)
delta_ratios = st.floats(0.0, 1.0)  # delta over phi
depths = st.floats(0.01, 3.0)
stresses = st.floats(0.0, 100e3)
factors = st.floats(1.01, 10.0)


def textbook(rake: float, beta, phi: float, delta: float):
    """Return N_gamma, N_c and their denominator D as published, for one or many beta."""
    cot = lambda angle: 1.0 / np.tan(angle)  # noqa: E731
    D = np.cos(rake + delta) + np.sin(rake + delta) * cot(beta + phi)
    return (cot(rake) + cot(beta)) / (2 * D), (1 + cot(beta) * cot(beta + phi)) / D, D


def blade(**changes: float) -> BladeForce:
    return compute_blade_force(**{**BUCKET, **LOAM, **changes})


@pytest.mark.parametrize("phi", [0.0, 10.0, 20.0, 30.0, 45.0])
def test_smooth_wall_has_rankine_passive_pressure(phi: float) -> None:
    wedge = WedgeFactors.from_angles(math.pi / 2, math.radians(phi), 0.0)
    passive = math.tan(math.radians(45.0 + phi / 2)) ** 2
    assert wedge.n_gamma == pytest.approx(passive / 2, rel=1e-12)
    assert wedge.n_q == pytest.approx(passive, rel=1e-12)
    assert wedge.n_c == pytest.approx(2 * math.sqrt(passive), rel=1e-12)
    assert math.degrees(wedge.beta) == pytest.approx(45.0 - phi / 2, rel=1e-12)


def test_rankine_coefficients_at_30_degrees() -> None:
    wedge = WedgeFactors.from_angles(math.pi / 2, math.radians(30.0), 0.0)
    assert wedge.n_gamma == pytest.approx(1.5, abs=1e-9)
    assert wedge.n_c == pytest.approx(3.4641, abs=5e-5)


def test_wedge_factors_of_a_rough_blade() -> None:
    wedge = WedgeFactors.from_angles(*map(math.radians, (60.0, 35.0, 23.0)))
    assert (wedge.n_gamma, wedge.n_c, wedge.n_q) == pytest.approx(
        (1.9545, 3.1616, 3.9091), abs=5e-5
    )
    assert wedge.rake == pytest.approx(math.radians(60.0), rel=1e-15)


@pytest.mark.parametrize(
    ("phi", "delta", "passive"), [(30.0, 15.0, 4.977), (30.0, 20.0, 6.105), (35.0, 35.0, 22.97)]
)
def test_rough_wall_has_coulomb_passive_pressure(phi: float, delta: float, passive: float) -> None:
    # Coulomb's coefficients for a vertical wall and level ground, as in tables.
    a, b = math.radians(phi), math.radians(delta)
    root = math.sqrt(math.sin(a + b) * math.sin(a) / math.cos(b))
    assert math.cos(a) ** 2 / (math.cos(b) * (1 - root) ** 2) == pytest.approx(passive, rel=1e-3)
    if math.pi / 2 + a + b <= MAX_ANGLE_SUM:
        assert WedgeFactors.from_angles(math.pi / 2, a, b).n_q == pytest.approx(passive, rel=1e-3)


@given(rake=rakes, phi=st.floats(0.02, math.radians(60.0)), delta_ratio=delta_ratios)
def test_failure_plane_minimizes_n_gamma(rake: float, phi: float, delta_ratio: float) -> None:
    delta = delta_ratio * phi
    wedge = WedgeFactors.from_angles(rake, phi, delta)
    end = math.pi - wedge.rake - delta - phi
    assert 0.0 < wedge.beta < end
    scan = np.linspace(0.0, end, 4002)[1:-1]
    n_gamma, _, D = textbook(wedge.rake, scan, phi, delta)
    assert (D > 0.0).all()
    assert wedge.n_gamma <= n_gamma.min() * (1 + 1e-9)
    assert wedge.n_gamma == pytest.approx(n_gamma.min(), rel=1e-2)


@given(rake=rakes, phi=st.floats(0.02, math.radians(60.0)), delta_ratio=delta_ratios)
def test_wedge_factors_are_those_of_the_textbook_at_the_failure_plane(
    rake: float, phi: float, delta_ratio: float
) -> None:
    wedge = WedgeFactors.from_angles(rake, phi, delta_ratio * phi)
    n_gamma, n_c, D = textbook(wedge.rake, wedge.beta, phi, delta_ratio * phi)
    n_a = (1 - 1 / math.tan(wedge.rake) / math.tan(wedge.beta + phi)) / D
    assert wedge.n_gamma == pytest.approx(n_gamma, rel=1e-9)
    assert wedge.n_c == pytest.approx(n_c, rel=1e-9)
    assert wedge.n_q == 2 * wedge.n_gamma
    assert wedge.n_a == pytest.approx(n_a, rel=1e-9, abs=1e-9)


@given(
    rake=st.floats(25.0, 90.0).map(math.radians),
    phi=st.floats(0.1, 0.6),
    delta_ratio=delta_ratios,
    depth=depths,
    cohesion=st.floats(1e3, 100e3),
    adhesion_ratio=st.floats(0.0, 0.5),
    surcharge=stresses,
)
def test_forces_on_the_wedge_are_in_equilibrium(
    rake: float,
    phi: float,
    delta_ratio: float,
    depth: float,
    cohesion: float,
    adhesion_ratio: float,
    surcharge: float,
) -> None:
    delta, gamma, adhesion = delta_ratio * phi, 16e3, adhesion_ratio * cohesion
    wedge = WedgeFactors.from_angles(rake, phi, delta)
    rake, beta = wedge.rake, wedge.beta
    tool = np.array(blade_force(1.0, depth, rake, surcharge, gamma, phi, delta, cohesion, adhesion))
    face = np.array([-math.cos(rake), math.sin(rake)])  # up along the blade
    into_soil = np.array([math.sin(rake), math.cos(rake)])
    plane = np.array([math.cos(beta), math.sin(beta)])  # up along the failure plane
    into_wedge = np.array([-math.sin(beta), math.cos(beta)])
    top = depth / math.tan(rake) + depth / math.tan(beta)
    # Forces on the wedge: blade, failure plane, weight and surcharge.
    on_wedge = np.array([tool[0], -tool[1]])
    resultant = on_wedge - np.array([0.0, (0.5 * gamma * depth + surcharge) * top])
    resultant -= cohesion * depth / math.sin(beta) * plane
    reaction = -resultant
    normal, along = reaction @ into_wedge, reaction @ plane
    size = np.abs(on_wedge).max()
    assert along == pytest.approx(-math.tan(phi) * normal, abs=1e-9 * size)
    # Friction and adhesion at the face are fully mobilized.
    normal_force, friction_force = on_wedge @ into_soil, on_wedge @ face
    shear = math.tan(delta) * normal_force + adhesion * depth / math.sin(rake)
    assert friction_force == pytest.approx(-shear, abs=1e-9 * size)


@given(
    rake=rakes,
    phi=frictions,
    delta_ratio=delta_ratios,
    depth=depths,
    cohesion=stresses,
    adhesion=stresses,
    surcharge=stresses,
    factor=factors,
)
def test_force_increases_with_size_weight_strength_and_surcharge(
    rake: float,
    phi: float,
    delta_ratio: float,
    depth: float,
    cohesion: float,
    adhesion: float,
    surcharge: float,
    factor: float,
) -> None:
    scene = {
        "width": 1.0,
        "depth": depth,
        "rake": rake,
        "gamma": 16e3,
        "phi": phi,
        "delta": delta_ratio * phi,
        "cohesion": cohesion,
        "adhesion": adhesion,
        "surcharge": surcharge,
    }
    force = compute_blade_force(**scene)
    assert math.isfinite(force.horizontal)
    assert math.isfinite(force.vertical)
    assert force.horizontal > 0.0
    for name in ("width", "depth", "gamma"):
        assert (
            compute_blade_force(**{**scene, name: scene[name] * factor}).horizontal
            > force.horizontal
        )
    for name in ("cohesion", "surcharge"):
        more = compute_blade_force(**{**scene, name: scene[name] + factor * 1e3})
        assert more.horizontal > force.horizontal
    more = compute_blade_force(**{**scene, "adhesion": adhesion + factor * 1e3})
    assert more.horizontal >= force.horizontal * (1 - 1e-12)


@given(rake=rakes, phi=frictions, delta_ratio=delta_ratios, depth=depths, factor=factors)
def test_force_scales_with_the_cube_of_size_and_strength(
    rake: float, phi: float, delta_ratio: float, depth: float, factor: float
) -> None:
    small = np.array(blade_force(1.0, depth, rake, 2e3, 16e3, phi, delta_ratio * phi, 5e3, 1e3))
    k = factor
    large = blade_force(k, k * depth, rake, k * 2e3, 16e3, phi, delta_ratio * phi, k * 5e3, k * 1e3)
    assert large == pytest.approx(k**3 * small, rel=1e-9)


@given(rake=rakes, phi=frictions, adhesion=st.floats(0.0, 1e6))
def test_force_on_the_blade_is_never_tensile(rake: float, phi: float, adhesion: float) -> None:
    horizontal, vertical = blade_force(1.0, 0.2, rake, 0.0, 16e3, phi, 0.0, 1e3, adhesion)
    rake = WedgeFactors.from_angles(rake, phi, 0.0).rake
    normal_force = horizontal * math.sin(rake) - vertical * math.cos(rake)
    assert normal_force >= -1e-9 * abs(horizontal)


def test_mobilized_adhesion_is_limited_to_the_weight_of_the_wedge() -> None:
    flat = {"rake": MIN_RAKE, "cohesion": 0.0}
    small, large, larger = (blade(**flat, adhesion=a) for a in (100.0, 50e3, 100e3))
    assert small.horizontal < large.horizontal
    assert large == larger
    assert large.vertical == pytest.approx(large.horizontal * math.tan(MIN_RAKE))  # along the face


def test_force_without_friction_is_perpendicular_to_the_face() -> None:
    for degrees in (30.0, 60.0, 90.0, 110.0):
        rake = math.radians(degrees)
        force = blade(rake=rake, delta=0.0, adhesion=0.0)
        assert force.vertical == pytest.approx(-force.horizontal / math.tan(rake), abs=1e-6)


def test_vertical_force_is_downward_on_a_flat_blade_and_upward_on_a_wall() -> None:
    assert blade(rake=math.radians(30.0), adhesion=0.0).vertical < 0.0
    wall = blade(rake=math.radians(90.0), adhesion=0.0)
    assert wall.vertical == pytest.approx(wall.horizontal * math.tan(LOAM["delta"]))


@pytest.mark.parametrize(
    ("changes", "horizontal", "vertical"),
    [
        ({}, 9.793e3, -0.688e3),
        ({"cohesion": 0.0, "adhesion": 0.0}, 1.490e3, -0.183e3),
        ({"gamma": 0.0, "adhesion": 0.0}, 7.531e3, -0.925e3),
        ({"gamma": 0.0, "cohesion": 0.0}, 0.772e3, 0.419e3),
        ({"depth": 0.4}, 22.565e3, -1.743e3),
    ],
)
def test_force_on_a_bucket_in_loam(
    changes: dict[str, float], horizontal: float, vertical: float
) -> None:
    force = blade(**changes)
    assert force.horizontal == pytest.approx(horizontal, abs=1.0)
    assert force.vertical == pytest.approx(vertical, abs=1.0)


def test_force_is_zero_without_depth_or_width() -> None:
    assert blade(depth=0.0) == blade(width=0.0) == BladeForce(0.0, 0.0)
    assert blade_force(1.2, -0.1, 1.0, 0.0, 16e3, 0.6, 0.4, 1e4, 0.0) == (0.0, 0.0)


def test_rake_angle_is_clamped_to_the_range_of_the_theory() -> None:
    assert blade(rake=math.radians(3.0)) == blade(rake=MIN_RAKE)
    last = MAX_ANGLE_SUM - LOAM["phi"] - LOAM["delta"]
    assert blade(rake=last - 0.01).horizontal < blade(rake=last).horizontal
    assert blade(rake=math.radians(140.0)) == blade(rake=last)
    assert WedgeFactors.from_angles(math.radians(140.0), LOAM["phi"], LOAM["delta"]).rake == last


def test_friction_at_the_face_is_limited_to_that_of_the_soil() -> None:
    assert blade(delta=LOAM["phi"] + 0.2) == blade(delta=LOAM["phi"])
    assert blade(phi=0.0) == blade(phi=0.0, delta=0.0)
    inside = blade_force(1.2, 0.2, 1.0, 0.0, 16e3, MAX_FRICTION, 0.0, 1e4, 2e3)
    assert blade_force(1.2, 0.2, 1.0, 0.0, 16e3, 1.4, -0.3, 1e4, 2e3) == inside
    # Weightless clay on a wall: 2 c d, failure plane at 45 deg.
    clay = blade(phi=0.0, rake=math.pi / 2, gamma=0.0, adhesion=0.0)
    assert clay.horizontal == pytest.approx(2 * 10e3 * 0.2 * 1.2)


@pytest.mark.parametrize("index", range(9))
def test_nan_argument_gives_nan(index: int) -> None:
    arguments = [1.2, 0.2, 1.0, 100.0, 16e3, 0.6, 0.4, 1e4, 2e3]
    arguments[index] = math.nan
    assert math.isnan(blade_force(*arguments)[0])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("width", -1.0),
        ("depth", math.nan),
        ("depth", math.inf),
        ("gamma", -1.0),
        ("cohesion", -1.0),
        ("adhesion", math.nan),
        ("surcharge", -1.0),
        ("rake", 0.0),
        ("rake", 60.0),
        ("rake", math.nan),
        ("phi", MAX_FRICTION + 0.01),
        ("phi", -0.1),
        ("delta", math.pi / 2),
        ("delta", math.nan),
    ],
)
def test_error_of_an_invalid_value_names_the_parameter(name: str, value: float) -> None:
    with pytest.raises(SoilError, match=rf"^{name} is .*; give "):
        blade(**{name: value})


def test_kernels_can_be_called_from_a_kernel() -> None:
    @njit
    def twice(rake):
        horizontal, vertical = blade_force(1.2, 0.2, rake, 0.0, 16e3, 0.6, 0.4, 1e4, 2e3)
        return 2.0 * horizontal, 2.0 * vertical, wedge_factors(rake, 0.6, 0.4)[1]

    horizontal, vertical, beta = twice(1.0)
    force = compute_blade_force(
        width=1.2,
        depth=0.2,
        rake=1.0,
        gamma=16e3,
        phi=0.6,
        delta=0.4,
        cohesion=1e4,
        adhesion=2e3,
    )
    assert (horizontal, vertical) == pytest.approx((2 * force.horizontal, 2 * force.vertical))
    assert beta == pytest.approx(WedgeFactors.from_angles(1.0, 0.6, 0.4).beta)
