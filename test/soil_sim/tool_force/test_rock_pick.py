"""Cutting force of a conical pick: Evans and Goktan against manual calculations, scaling."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from soil_sim.errors import SoilError
from soil_sim.tool_force import evans_force, goktan_force, pick_force

PICK = {
    "depth": 0.010,
    "tip_angle": math.radians(80.0),
    "tensile_strength": 5e6,
    "compressive_strength": 80e6,
    "friction": math.radians(10.0),
}
MODELS = ("evans", "goktan")


def test_evans_force_equals_a_manual_calculation() -> None:
    # 16 pi (5e6)^2 0.01^2 = 125,663.7e6; cos^2(40 deg) = 0.586824; times 80e6: 46.94593e6
    assert pick_force(**PICK, model="evans").cutting == pytest.approx(2676.77, abs=0.01)


def test_goktan_force_equals_a_manual_calculation() -> None:
    # 4 pi 5e6 0.01^2 = 6283.185; sin^2(50 deg) = 0.586824; cos(50 deg) = 0.642788
    assert pick_force(**PICK, model="goktan").cutting == pytest.approx(5736.15, abs=0.01)


def test_force_of_a_right_angled_cone_without_friction() -> None:
    cone = {**PICK, "tip_angle": math.pi / 2, "friction": 0.0}
    # In N, mm and MPa: evans 16 pi 25 100 / (0.5 80), goktan 4 pi 5 100 (0.5 / sqrt 0.5)
    assert pick_force(**cone, model="evans").cutting == pytest.approx(1000 * math.pi)
    assert pick_force(**cone, model="goktan").cutting == pytest.approx(
        1000 * math.pi * math.sqrt(2.0)
    )


@pytest.mark.parametrize("model", MODELS)
@given(factor=st.floats(0.1, 10.0))
def test_force_scales_with_strength_and_depth_squared(model: str, factor: float) -> None:
    force = pick_force(**PICK, model=model).cutting
    deeper = {**PICK, "depth": factor * PICK["depth"]}
    assert pick_force(**deeper, model=model).cutting == pytest.approx(factor**2 * force)
    stronger = {**PICK, **{k: factor * PICK[k] for k in PICK if k.endswith("strength")}}
    assert pick_force(**stronger, model=model).cutting == pytest.approx(factor * force)


@pytest.mark.parametrize("model", MODELS)
@given(tip=st.floats(1.0, 150.0), increase=st.floats(0.1, 9.0))
def test_force_increases_with_the_tip_angle(model: str, tip: float, increase: float) -> None:
    sharp, blunt = (
        pick_force(**{**PICK, "tip_angle": math.radians(angle)}, model=model)
        for angle in (tip, tip + increase)
    )
    assert 0.0 < sharp.cutting < blunt.cutting < math.inf


def test_friction_affects_the_goktan_model_only() -> None:
    smooth = {**PICK, "friction": 0.0}
    assert pick_force(**smooth, model="evans") == pick_force(**PICK, model="evans")
    assert pick_force(**smooth, model="goktan").cutting < pick_force(**PICK, model="goktan").cutting


def test_compressive_strength_affects_the_evans_model_only() -> None:
    hard = {**PICK, "compressive_strength": 160e6}
    assert pick_force(**hard, model="goktan") == pick_force(**PICK, model="goktan")
    assert pick_force(**hard, model="evans").cutting == pytest.approx(2676.77 / 2, abs=0.01)


def test_normal_force_is_the_given_ratio_of_the_cutting_force() -> None:
    assert pick_force(**PICK).normal == pick_force(**PICK).cutting
    worn = pick_force(**PICK, normal_ratio=1.8)
    assert worn.cutting == pick_force(**PICK).cutting
    assert worn.normal == pytest.approx(1.8 * worn.cutting)


@pytest.mark.parametrize("model", MODELS)
def test_force_is_zero_without_depth(model: str) -> None:
    assert pick_force(**{**PICK, "depth": 0.0}, model=model).cutting == 0.0
    assert evans_force(-0.01, 1.4, 5e6, 80e6) == goktan_force(-0.01, 1.4, 5e6, 0.2) == 0.0


@pytest.mark.parametrize("index", range(4))
def test_nan_argument_gives_nan(index: int) -> None:
    for kernel, arguments in (
        (evans_force, [0.01, 1.4, 5e6, 80e6]),
        (goktan_force, [0.01, 1.4, 5e6, 0.2]),
    ):
        arguments[index] = math.nan
        assert math.isnan(kernel(*arguments))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("depth", -0.01),
        ("depth", math.nan),
        ("depth", math.inf),
        ("tip_angle", 0.0),
        ("tip_angle", 80.0),
        ("tensile_strength", 0.0),
        ("tensile_strength", 80e6),
        ("tensile_strength", math.nan),
        ("friction", -0.1),
        ("friction", math.radians(50.0)),
        ("friction", math.nan),
        ("normal_ratio", -1.0),
        ("normal_ratio", math.nan),
        ("model", "merchant"),
    ],
)
def test_error_of_an_invalid_value_names_the_parameter(name: str, value: object) -> None:
    with pytest.raises(SoilError, match=rf"^{name} is .*; give "):
        pick_force(**{**PICK, name: value})


def test_kernels_can_be_called_from_a_kernel() -> None:
    @njit
    def both(depth):
        return evans_force(depth, 1.4, 5e6, 80e6) + goktan_force(depth, 1.4, 5e6, 0.2)

    assert both(0.01) == pytest.approx(
        evans_force(0.01, 1.4, 5e6, 80e6) + goktan_force(0.01, 1.4, 5e6, 0.2)
    )
