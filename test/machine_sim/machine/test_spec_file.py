"""Machine files: values that are read, and errors that name key and remedy."""

import copy
import math
from pathlib import Path

import pytest
import yaml

from machine_sim.machine import EXCAVATOR_JOINTS, MachineError, load_machine_spec
from msg_bridge.contract.errors import EarthmovingError

FILE = Path(__file__).resolve().parents[3] / "config" / "machines" / "excavator.yaml"
VALUES = yaml.safe_load(FILE.read_text())


def edited_file(tmp_path, edit):
    values = copy.deepcopy(VALUES)
    edit(values)
    path = tmp_path / "machine.yaml"
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path


def test_mass_of_the_excavator_is_the_sum_of_its_links(spec):
    assert spec.mass == 21_450.0
    assert tuple(spec.joints) == EXCAVATOR_JOINTS


def test_swing_is_continuous_and_arm_has_limits(spec):
    assert math.isinf(spec.joints["swing"].upper)
    assert (spec.joints["arm"].lower, spec.joints["arm"].upper) == (0.55, 2.6)


def test_shoe_pitch_closes_the_belt(spec):
    tracks = spec.tracks
    assert tracks.pitch * tracks.shoe_count == pytest.approx(2 * 3.144 + 2 * math.pi * 0.36)


def test_arrays_of_a_specification_are_read_only(spec):
    with pytest.raises(ValueError, match="read-only"):
        spec.home[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        spec.bucket.profile[0, 0] = 1.0


def swap(profile):
    profile[2], profile[3] = profile[3], profile[2]


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda v: v.pop("main_body"), r"main_body is missing; add it"),
        (lambda v: v.update(main_body="arm"), r"main_body is 'arm'; give one of base, upper"),
        (lambda v: v["tracks"].update(guage=2.0), r"tracks has unknown key guage .*gauge"),
        (lambda v: v["links"].update(mast={}), r"links has unknown key mast"),
        (lambda v: v["links"]["arm"].update(mass=-1.0), r"links.arm.mass is -1.0; .*above 0"),
        (lambda v: v["links"]["arm"].update(mass="heavy"), r"links.arm.mass is 'heavy'; .*number"),
        (lambda v: v["links"]["arm"].update(mass=True), r"links.arm.mass is True; give a number"),
        (
            lambda v: v["joints"]["arm"].update(origin=[math.nan, 0.0, 0.0]),
            r"joints.arm.origin is nan",
        ),
        (lambda v: v["joints"]["boom"].update(origin=[0.0, 1.0]), r"origin is .*list of 3 numbers"),
        (
            lambda v: v["joints"]["boom"].update(origin=[0.0, 1.0, 0.0]),
            r"joints.boom.cylinder needs a joint with limits",
        ),
        (lambda v: v["joints"]["arm"].update(axis="w"), r"joints.arm.axis is 'w'; give one of x"),
        (
            lambda v: v["joints"]["arm"].update(parent="mast"),
            r"joints.arm connects 'mast' to 'arm'; give one of base, upper, boom",
        ),
        (lambda v: v["joints"]["arm"].update(child="boom"), r"joints.arm connects .* to 'boom'"),
        (lambda v: v["tools"]["bucket"].update(link="hand"), r"tools.bucket.link is 'hand'; .*arm"),
        (
            lambda v: (
                v["joints"].update(left_track=v["joints"].pop("bucket"))
                or v["home"].update(left_track=v["home"].pop("bucket"))
            ),
            r"name left_track is reserved",
        ),
        (lambda v: v["links"]["arm"].update(mass="8e2"), r"'8e2'; .*exponent as in 24.0e\+3"),
        (
            lambda v: v["tools"]["bucket"].update(link="base"),
            r"give a link that a joint moves: upper",
        ),
        (
            lambda v: v["tools"].update(
                mill={
                    "link": "upper",
                    "kind": "drum",
                    "radius": 0.5,
                    "body_radius": 0.4,
                    "width": 1.0,
                }
            ),
            r"tools.mill is a drum on link upper, whose joint rotates about z",
        ),
        (lambda v: v["tools"]["bucket"].update(kind="fork"), r"kind is 'fork'; give one of bucket"),
        (lambda v: v["joints"]["arm"].update(lower=3.0), r"joints.arm.lower is 3.0 .*below"),
        (lambda v: v["joints"]["arm"].update(lower=None), r"joints.arm has one limit"),
        (lambda v: v["home"].update(boom=2.0), r"home.boom is 2.0; give an angle from -1.05 to"),
        (lambda v: v["tracks"].update(shoe_count=45.5), r"shoe_count is 45.5; .*integer"),
        (lambda v: v["tracks"].update(friction=-0.1), r"friction is -0.1; give a number >= 0"),
        (
            lambda v: v["tools"]["bucket"]["profile"].pop(),
            r"bucket.profile has 6 entries; .*7 entries",
        ),
        (lambda v: swap(v["tools"]["bucket"]["profile"]), r"bucket.profile is not convex"),
        (
            lambda v: v["tools"]["bucket"]["profile"].reverse(),
            r"bucket.profile\[0\] is .*the cutting lip",
        ),
        (lambda v: v["tools"]["bucket"].update(width=0.0), r"bucket.width is 0.0; .*above 0"),
        (lambda v: v.update(tracks=3), r"tracks is 3; give a mapping"),
        (lambda v: v.update(wheels=3), r"the file has unknown key wheels"),
        (lambda v: v.clear(), r"joints is missing"),
    ],
)
def test_invalid_file_is_rejected_with_its_name_key_and_remedy(tmp_path, edit, words):
    with pytest.raises(MachineError, match=rf"^machine\.yaml: .*{words}"):
        load_machine_spec(edited_file(tmp_path, edit))


def test_unreadable_file_is_rejected(tmp_path):
    with pytest.raises(EarthmovingError, match="cannot be read"):
        load_machine_spec(tmp_path / "none.yaml")
    bad = tmp_path / "bad.yaml"
    bad.write_text("a: [1")
    with pytest.raises(EarthmovingError, match="cannot be read"):
        load_machine_spec(bad)


@pytest.mark.parametrize(
    ("imus", "message"),
    [
        ({"cab roof": {"link": "upper", "position": [0, 0, 0]}}, "use letters, digits"),
        ({"cab": {"link": "cab", "position": [0, 0, 0]}}, "imus.cab.link is 'cab'; give one of"),
        ({"cab": {"link": "upper"}}, r"imus\.cab\.position is missing"),
    ],
)
def test_invalid_imu_is_rejected(tmp_path, imus, message):
    path = edited_file(tmp_path, lambda values: values.update(imus=imus))
    with pytest.raises(MachineError, match=message):
        load_machine_spec(path)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda v: v["joints"]["boom"].update(max_effort=1e5), "joints.boom needs one drive"),
        (lambda v: v["joints"]["boom"].pop("cylinder"), "joints.boom needs one drive"),
        (lambda v: v.pop("hydraulics"), "add `hydraulics`"),
        (lambda v: v["joints"]["swing"].update(max_effort=1e5), "joints.swing needs one drive"),
        (
            lambda v: v["tracks"]["motor"].update(relief_pressure=1e5),
            "tracks.motor.relief_pressure",
        ),
        (lambda v: v["hydraulics"].update(engine_droop=1.2), "engine_droop is 1.2; give a number"),
        (
            lambda v: v["joints"]["swing"]["motor"].update(brake_relief_pressure=1e5),
            "brake_relief_pressure is 100000 Pa; give more than",
        ),
        (
            lambda v: v["joints"]["swing"].update(cylinder=v["joints"]["swing"].pop("motor")),
            "cylinder needs a joint with limits",
        ),
        (
            lambda v: v["joints"]["arm"]["cylinder"].update(rod_diameter=0.2),
            "give less than the bore, 0.14 m",
        ),
        (
            lambda v: v["joints"]["arm"]["cylinder"].update(barrel=[4.4, 0.6]),
            "more than its rod allows",
        ),
        (
            lambda v: v["joints"]["bucket"]["cylinder"]["rocker"].update(coupler_length=0.3),
            "joints.bucket.cylinder: rocker and coupler do not reach",
        ),
        (
            lambda v: v["hydraulics"].update(port_relief_pressure=1e7),
            "not in ascending order",
        ),
    ],
)
def test_invalid_cylinder_or_supply_is_rejected(tmp_path, edit, message):
    with pytest.raises(MachineError, match=rf"^machine\.yaml: .*{message}"):
        load_machine_spec(edited_file(tmp_path, edit))
