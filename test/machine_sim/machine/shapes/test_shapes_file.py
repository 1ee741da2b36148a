"""Shapes of a machine file: where they are read from, and errors that name key and remedy."""

import copy
from pathlib import Path

import pytest
import yaml

from machine_sim.machine import MachineError, load_machine_spec, urdf_text
from machine_sim.machine.shapes.link_meshes import link_meshes

CONFIG = Path(__file__).resolve().parents[4] / "config"
MACHINE = yaml.safe_load((CONFIG / "machines" / "excavator.yaml").read_text())
PROFILE = {
    "kind": "profile",
    "material": "paint",
    "points": [[0.0, 0.0], [1.0, 0.0, 0.1], [1.0, 1.0]],
    "width": 0.5,
}
SHAPES = {
    "materials": {"paint": {"color": [0.1, 0.2, 0.3]}, "brass": {"color": [0.8, 0.7, 0.2]}},
    "links": {"boom": [PROFILE]},
    "view_points": {"cab_camera": {"link": "upper", "position": [0.0, 0.0, 1.0]}},
}


def load(tmp_path, shapes):
    path = tmp_path / "machine.yaml"
    path.write_text(yaml.safe_dump({**MACHINE, "shapes": shapes}, sort_keys=False))
    return load_machine_spec(path)


def test_shapes_may_be_in_the_machine_file_or_beside_it(tmp_path):
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(SHAPES))
    inside, beside = load(tmp_path, SHAPES), load(tmp_path, "mine.yaml")
    assert inside.shapes.links == beside.shapes.links
    assert inside.shapes.view_points == beside.shapes.view_points


def test_shapes_leave_the_urdf_of_the_physics_unchanged(tmp_path):
    assert urdf_text(load(tmp_path, SHAPES)) == urdf_text(load(tmp_path, {}))


def test_material_of_the_machine_changes_only_the_given_values(tmp_path):
    (group,) = link_meshes(load(tmp_path, SHAPES))["boom"]
    assert group.material.color == (0.1, 0.2, 0.3)
    assert group.material.roughness == pytest.approx(0.38)


def test_link_without_shapes_shows_its_boxes_in_its_colour(tmp_path):
    spec = load(tmp_path, SHAPES)
    (group,) = link_meshes(spec)["arm"]
    assert len(group.mesh.triangles) == 12 * len(spec.links["arm"].boxes)
    assert group.material.color == spec.links["arm"].color


def test_copies_of_a_shape_are_mirrored_and_in_a_row(tmp_path):
    row = {"count": 3, "step": [1.0, 0.0, 0.0]}
    several = {**PROFILE, "position": 2.0, "mirror": True, "repeat": row}
    one, six = (
        link_meshes(load(tmp_path, {"links": {"boom": [shape]}}))["boom"][0].mesh
        for shape in (PROFILE, several)
    )
    assert len(six.triangles) == 6 * len(one.triangles)
    assert six.points.min(axis=0).tolist() == pytest.approx([0.0, -2.25, 0.0])
    assert six.points.max(axis=0).tolist() == pytest.approx([3.0, 2.25, 1.0])


def edit_profile(**changes):
    return lambda shapes: shapes["links"]["boom"][0].update(changes)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (edit_profile(kind="profil"), r"links.boom\[0\].kind is 'profil' \(did you mean 'profile'"),
        (edit_profile(material="stel"), r"boom\[0\].material is 'stel' .*'steel'.*add it to mat"),
        (edit_profile(axis="w"), r"boom\[0\].axis is 'w'; give x, y or z"),
        (edit_profile(bevel=0.25), r"boom\[0\].bevel is 0.25; give less than half of the width"),
        (edit_profile(points=[[0, 0], [1, 0]]), r"points is .*; give a list of three or more"),
        (edit_profile(points=[[0, 0], [1, 0, -1], [1, 1]]), r"points\[1\] has the radius -1"),
        (edit_profile(mirror="yes"), r"boom\[0\].mirror is 'yes'; give true or false"),
        (edit_profile(size=[1, 1, 1]), r"boom\[0\] has unknown key size"),
        (lambda s: s["links"].update(mast=[]), r"links.mast is not a link; give one of base"),
        (lambda s: s["materials"]["brass"].update(metallic=2), r"metallic is 2; .* from 0 to 1"),
        (lambda s: s["view_points"]["cab_camera"].update(link="cab"), r"cab_camera.link is 'cab'"),
        (lambda s: s["view_points"].update(boom={"link": "arm", "position": [0, 0, 0]}), r"boom"),
        (lambda s: s.update(colours={}), r"shapes has unknown key colours"),
    ],
)
def test_error_names_the_key_and_the_remedy(tmp_path, edit, words):
    shapes = copy.deepcopy(SHAPES)
    edit(shapes)
    with pytest.raises(MachineError, match=words):
        load(tmp_path, shapes)


def test_error_in_a_file_of_shapes_names_that_file(tmp_path):
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump({"links": {"mast": []}}))
    with pytest.raises(MachineError, match=r"^mine\.yaml: links\.mast is not a link"):
        load(tmp_path, "mine.yaml")


def test_missing_file_of_shapes_is_an_error(tmp_path):
    with pytest.raises(MachineError, match=r"^machine\.yaml: shapes: There is no .* 'mine\.yaml'"):
        load(tmp_path, "mine.yaml")


def test_shape_that_cannot_be_built_is_named(tmp_path):
    thin = {**PROFILE, "points": [[0, 0], [1, 0], [1, 0.1], [0, 0.1]], "bevel": 0.2}
    spec = load(tmp_path, {"links": {"boom": [PROFILE, thin]}})
    with pytest.raises(MachineError, match=r"links\.boom\[1\]: bevel 0\.2 m is wider"):
        link_meshes(spec)
