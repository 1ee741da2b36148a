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
parts = st.floats(0.0, 1.0)  # delta over phi
depths = st.floats(0.01, 3.0)
stresses = st.floats(0.0, 100e3)
factors = st.floats(1.01, 10.0)


def textbook(rake: float, beta, phi: float, delta: float):
    """N_gamma, N_c and D as printed, for one or many beta."""
    cot = lambda angle: 1.0 / np.tan(angle)  # noqa: E731
    D = np.cos(rake + delta) + np.sin(rake + delta) * cot(beta + phi)
    return (cot(rake) + cot(beta)) / (2 * D), (1 + cot(beta) * cot(beta + phi)) / D, D


def blade(**changes: float) -> BladeForce:
    return compute_blade_force(**{**BUCKET, **LOAM, **changes})


@pytest.mark.parametrize("phi", [0.0, 10.0, 20.0, 30.0, 45.0])
def test_a_smooth_wall_has_rankine_s_passive_pressure(phi: float) -> None:
    wedge = WedgeFactors.from_angles(math.pi / 2, math.radians(phi), 0.0)
    passive = math.tan(math.radians(45.0 + phi / 2)) ** 2
    assert wedge.n_gamma == pytest.approx(passive / 2, rel=1e-12)
    assert wedge.n_q == pytest.approx(passive, rel=1e-12)
    assert wedge.n_c == pytest.approx(2 * math.sqrt(passive), rel=1e-12)
    assert math.degrees(wedge.beta) == pytest.approx(45.0 - phi / 2, rel=1e-12)


def test_rankine_s_numbers_at_thirty_degrees() -> None:
    wedge = WedgeFactors.from_angles(math.pi / 2, math.radians(30.0), 0.0)
    assert wedge.n_gamma == pytest.approx(1.5, abs=1e-9)
    assert wedge.n_c == pytest.approx(3.4641, abs=5e-5)


def test_the_factors_of_a_rough_blade() -> None:
    wedge = WedgeFactors.from_angles(*map(math.radians, (60.0, 35.0, 23.0)))
    assert (wedge.n_gamma, wedge.n_c, wedge.n_q) == pytest.approx(
        (1.9545, 3.1616, 3.9091), abs=5e-5
    )
    assert wedge.rake == pytest.approx(math.radians(60.0), rel=1e-15)


@pytest.mark.parametrize(
    ("phi", "delta", "passive"), [(30.0, 15.0, 4.977), (30.0, 20.0, 6.105), (35.0, 35.0, 22.97)]
)
def test_a_rough_wall_has_coulomb_s_passive_pressure(
    phi: float, delta: float, passive: float
) -> None:
    # Coulomb's coefficients for a vertical wall and level ground, as in tables.
    a, b = math.radians(phi), math.radians(delta)
    root = math.sqrt(math.sin(a + b) * math.sin(a) / math.cos(b))
    assert math.cos(a) ** 2 / (math.cos(b) * (1 - root) ** 2) == pytest.approx(passive, rel=1e-3)
    if math.pi / 2 + a + b <= MAX_ANGLE_SUM:
        assert WedgeFactors.from_angles(math.pi / 2, a, b).n_q == pytest.approx(passive, rel=1e-3)


@given(rake=rakes, phi=st.floats(0.02, math.radians(60.0)), part=parts)
def test_no_other_plane_fails_more_easily(rake: float, phi: float, part: float) -> None:
    delta = part * phi
    wedge = WedgeFactors.from_angles(rake, phi, delta)
    end = math.pi - wedge.rake - delta - phi
    assert 0.0 < wedge.beta < end
    scan = np.linspace(0.0, end, 4002)[1:-1]
    n_gamma, _, D = textbook(wedge.rake, scan, phi, delta)
    assert (D > 0.0).all()
    assert wedge.n_gamma <= n_gamma.min() * (1 + 1e-9)
    assert wedge.n_gamma == pytest.approx(n_gamma.min(), rel=1e-2)


@given(rake=rakes, phi=st.floats(0.02, math.radians(60.0)), part=parts)
def test_the_factors_are_the_textbook_s_at_that_plane(rake: float, phi: float, part: float) -> None:
    wedge = WedgeFactors.from_angles(rake, phi, part * phi)
    n_gamma, n_c, D = textbook(wedge.rake, wedge.beta, phi, part * phi)
    n_a = (1 - 1 / math.tan(wedge.rake) / math.tan(wedge.beta + phi)) / D
    assert wedge.n_gamma == pytest.approx(n_gamma, rel=1e-9)
    assert wedge.n_c == pytest.approx(n_c, rel=1e-9)
    assert wedge.n_q == 2 * wedge.n_gamma
    assert wedge.n_a == pytest.approx(n_a, rel=1e-9, abs=1e-9)


@given(
    rake=st.floats(25.0, 90.0).map(math.radians),
    phi=st.floats(0.1, 0.6),
    part=parts,
    depth=depths,
    cohesion=st.floats(1e3, 100e3),
    stick=st.floats(0.0, 0.5),
    surcharge=stresses,
)
def test_the_wedge_is_in_balance(
    rake: float,
    phi: float,
    part: float,
    depth: float,
    cohesion: float,
    stick: float,
    surcharge: float,
) -> None:
    delta, gamma, adhesion = part * phi, 16e3, stick * cohesion
    wedge = WedgeFactors.from_angles(rake, phi, delta)
    rake, beta = wedge.rake, wedge.beta
    tool = np.array(blade_force(1.0, depth, rake, surcharge, gamma, phi, delta, cohesion, adhesion))
    face = np.array([-math.cos(rake), math.sin(rake)])  # up along the blade
    into_soil = np.array([math.sin(rake), math.cos(rake)])
    plane = np.array([math.cos(beta), math.sin(beta)])  # up along the failure plane
    into_wedge = np.array([-math.sin(beta), math.cos(beta)])
    top = depth / math.tan(rake) + depth / math.tan(beta)
    # What holds the wedge is the blade, the ground below, its weight and the surcharge.
    on_wedge = np.array([tool[0], -tool[1]])
    known = on_wedge - np.array([0.0, (0.5 * gamma * depth + surcharge) * top])
    known -= cohesion * depth / math.sin(beta) * plane
    ground = -known
    normal, along = ground @ into_wedge, ground @ plane
    size = np.abs(on_wedge).max()
    assert along == pytest.approx(-math.tan(phi) * normal, abs=1e-9 * size)
    # On the face, friction and adhesion are called up whole.
    press, rub = on_wedge @ into_soil, on_wedge @ face
    shear = math.tan(delta) * press + adhesion * depth / math.sin(rake)
    assert rub == pytest.approx(-shear, abs=1e-9 * size)


@given(
    rake=rakes,
    phi=frictions,
    part=parts,
    depth=depths,
    cohesion=stresses,
    adhesion=stresses,
    surcharge=stresses,
    factor=factors,
)
def test_the_force_grows_with_all_that_resists(
    rake: float,
    phi: float,
    part: float,
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
        "delta": part * phi,
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


@given(rake=rakes, phi=frictions, part=parts, depth=depths, factor=factors)
def test_twice_the_size_and_the_strength_is_eight_times_the_force(
    rake: float, phi: float, part: float, depth: float, factor: float
) -> None:
    small = np.array(blade_force(1.0, depth, rake, 2e3, 16e3, phi, part * phi, 5e3, 1e3))
    k = factor
    large = blade_force(k, k * depth, rake, k * 2e3, 16e3, phi, part * phi, k * 5e3, k * 1e3)
    assert large == pytest.approx(k**3 * small, rel=1e-9)


@given(rake=rakes, phi=frictions, adhesion=st.floats(0.0, 1e6))
def test_the_blade_presses_and_never_pulls(rake: float, phi: float, adhesion: float) -> None:
    horizontal, vertical = blade_force(1.0, 0.2, rake, 0.0, 16e3, phi, 0.0, 1e3, adhesion)
    rake = WedgeFactors.from_angles(rake, phi, 0.0).rake
    press = horizontal * math.sin(rake) - vertical * math.cos(rake)
    assert press >= -1e-9 * abs(horizontal)


def test_adhesion_that_carries_the_wedge_is_not_called_up_further() -> None:
    flat = {"rake": MIN_RAKE, "cohesion": 0.0}
    some, much, more = (blade(**flat, adhesion=a) for a in (100.0, 50e3, 100e3))
    assert some.horizontal < much.horizontal
    assert much == more
    assert much.vertical == pytest.approx(much.horizontal * math.tan(MIN_RAKE))  # along the face


def test_without_friction_the_force_is_square_to_the_face() -> None:
    for degrees in (30.0, 60.0, 90.0, 110.0):
        rake = math.radians(degrees)
        force = blade(rake=rake, delta=0.0, adhesion=0.0)
        assert force.vertical == pytest.approx(-force.horizontal / math.tan(rake), abs=1e-6)


def test_a_flat_blade_is_pulled_down_and_a_wall_is_lifted() -> None:
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
def test_a_bucket_in_loam(changes: dict[str, float], horizontal: float, vertical: float) -> None:
    force = blade(**changes)
    assert force.horizontal == pytest.approx(horizontal, abs=1.0)
    assert force.vertical == pytest.approx(vertical, abs=1.0)


def test_no_depth_or_no_width_is_no_force() -> None:
    assert blade(depth=0.0) == blade(width=0.0) == BladeForce(0.0, 0.0)
    assert blade_force(1.2, -0.1, 1.0, 0.0, 16e3, 0.6, 0.4, 1e4, 0.0) == (0.0, 0.0)


def test_the_rake_is_held_where_the_theory_ends() -> None:
    assert blade(rake=math.radians(3.0)) == blade(rake=MIN_RAKE)
    last = MAX_ANGLE_SUM - LOAM["phi"] - LOAM["delta"]
    assert blade(rake=last - 0.01).horizontal < blade(rake=last).horizontal
    assert blade(rake=math.radians(140.0)) == blade(rake=last)
    assert WedgeFactors.from_angles(math.radians(140.0), LOAM["phi"], LOAM["delta"]).rake == last


def test_a_face_rougher_than_the_soil_is_as_rough_as_the_soil() -> None:
    assert blade(delta=LOAM["phi"] + 0.2) == blade(delta=LOAM["phi"])
    assert blade(phi=0.0) == blade(phi=0.0, delta=0.0)
    inside = blade_force(1.2, 0.2, 1.0, 0.0, 16e3, MAX_FRICTION, 0.0, 1e4, 2e3)
    assert blade_force(1.2, 0.2, 1.0, 0.0, 16e3, 1.4, -0.3, 1e4, 2e3) == inside
    # 2 c d on a wall in clay without weight: the plane at 45 deg.
    clay = blade(phi=0.0, rake=math.pi / 2, gamma=0.0, adhesion=0.0)
    assert clay.horizontal == pytest.approx(2 * 10e3 * 0.2 * 1.2)


@pytest.mark.parametrize("place", range(9))
def test_what_is_not_a_number_gives_no_number(place: int) -> None:
    arguments = [1.2, 0.2, 1.0, 100.0, 16e3, 0.6, 0.4, 1e4, 2e3]
    arguments[place] = math.nan
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
def test_a_value_that_makes_no_sense_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(SoilError, match=rf"^{name} is .*; give "):
        blade(**{name: value})


def test_the_kernels_can_be_called_from_a_kernel() -> None:
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
