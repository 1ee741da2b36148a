"""The page gets the machine of its robot description."""

from __future__ import annotations

import base64

import pytest

from machine_sim.machine import load_machine_spec
from machine_sim.machine.description import description_text
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.machine_state import BASE_JOINTS
from msg_bridge.config_files import find_config
from viewer.scene.machine_model import HydraulicsModel, Origin, Visual
from viewer.scene.urdf import parse_urdf

LINK = '<robot name="r"><link name="a"><visual>{}</visual></link></robot>'


@pytest.mark.parametrize("name", ["excavator", "dumper", "road_header"])
def test_shipped_machines_are_read(name: str) -> None:
    spec = load_machine_spec(find_config(f"machines/{name}.yaml"))
    model = parse_urdf(description_text(spec))
    assert set(spec.joint_names) <= set(model.joint_index)
    assert list(model.joint_index)[: len(BASE_JOINTS)] == list(BASE_JOINTS)
    assert model.has_virtual_base
    meshes = [each.glb for visuals in model.links.values() for each in visuals if each.glb]
    assert meshes
    assert all(each.startswith(b"glTF") for each in meshes)
    assert len(model.tracks) == 2
    assert all(track.joint in model.joint_index for track in model.tracks)
    assert model.rated_power is not None
    assert model.rated_power > 1e4
    assert spec.supply is not None
    assert model.hydraulics == HydraulicsModel(
        spec.supply.main_relief_pressure, spec.supply.port_relief_pressure
    )


def test_plain_urdf_is_read() -> None:
    geometry = '<geometry><cylinder radius="0.5" length="2"/></geometry>'
    text = LINK.format(f'<origin xyz="1 2 3" rpy="0 0 1"/>{geometry}<material name="m"/>').replace(
        "</robot>", '<material name="m"><color rgba="1 0 0 1"/></material></robot>'
    )
    (visual,) = parse_urdf(text).links["a"]
    origin = Origin((1.0, 2.0, 3.0), (0.0, 0.0, 1.0))
    assert visual == Visual("cylinder", origin, (1.0, 0.0, 0.0, 1.0), radius=0.5, length=2.0)


def test_meshes_of_other_files_are_left_out() -> None:
    content = base64.b64encode(b"glTF").decode()
    own = f'<geometry><mesh filename="data:model/gltf-binary;base64,{content}"/></geometry>'
    other = '<geometry><mesh filename="package://x/y.stl"/></geometry>'
    assert parse_urdf(LINK.format(own)).links["a"][0].glb == b"glTF"
    assert parse_urdf(LINK.format(other)).links["a"] == ()


@pytest.mark.parametrize(
    "text",
    [
        "no xml",
        "<other/>",
        '<!DOCTYPE r [<!ENTITY a "b">]><robot name="r"/>',
        LINK.format('<geometry><box size="1 2"/></geometry>'),
        LINK.format('<geometry><box size="1 2 nan"/></geometry>'),
        LINK.format("<geometry><sphere/></geometry>"),
        LINK.format('<geometry><mesh filename="data:model/gltf-binary;base64,@"/></geometry>'),
        '<robot name="r"><joint name="j" type="fixed"/></robot>',
    ],
)
def test_invalid_descriptions_are_rejected(text: str) -> None:
    with pytest.raises(CodecError):
        parse_urdf(text)
