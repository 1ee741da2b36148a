"""Messages set the scene: what a machine is, and what is reported of it."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String

from machine_sim.machine import load_machine_spec
from machine_sim.machine.description import description_text
from msg_bridge.codec.errors import CodecError
from msg_bridge.config_files import find_config
from viewer.scene.machine_view import MachineView
from viewer.scene.scene import Scene
from viewer.sources.scene_writer import SceneWriter

EXCAVATOR = load_machine_spec(find_config("machines/excavator.yaml"))
DESCRIPTION = String(data=description_text(EXCAVATOR, meshes="primitives"))
MACHINE = "/excavator"


def config(pattern: str, comment: str = "") -> String:
    return String(data=f"commands: {{joy_pattern: {pattern}}}\n# {comment}\n")


@pytest.fixture
def writer() -> SceneWriter:
    writer = SceneWriter(Scene())
    writer.on_description(MACHINE, DESCRIPTION)
    writer.on_machine_config(MACHINE, config("iso"))
    return writer


def view(writer: SceneWriter) -> MachineView:
    return writer.scene.machines[MACHINE]


def test_unchanged_machine_has_the_same_version(writer: SceneWriter) -> None:
    version = view(writer).model_version
    assert view(writer).levers
    writer.on_description(MACHINE, DESCRIPTION)
    writer.on_machine_config(MACHINE, config("iso", "of another run"))
    assert view(writer).model_version == version
    writer.on_machine_config(MACHINE, config("sae"))
    assert view(writer).model_version > version


def test_machine_that_comes_back_has_another_version(writer: SceneWriter) -> None:
    version = view(writer).model_version
    writer.scene.remove_machine(MACHINE)
    writer.on_description(MACHINE, DESCRIPTION)
    assert view(writer).model_version > version


def test_load_is_the_power_of_all_drives_without_those_that_their_load_moves(
    writer: SceneWriter,
) -> None:
    assert EXCAVATOR.supply is not None
    joints = JointState(
        name=["boom", "arm", "swing", "left_sprocket", "base_yaw"],
        position=[0.0] * 5,
        velocity=[0.2, -0.3, 1.0, 2.0, 1.0],
        effort=[-90e3, -20e3, 5e3, 4e3, 0.0],  # the boom goes down by its own weight
    )
    writer.on_joints(MACHINE, joints)
    rated = EXCAVATOR.supply.engine_power
    assert view(writer).load == pytest.approx((6e3 + 5e3 + 8e3) / rated)
    joints.effort[2] = 1e9
    writer.on_joints(MACHINE, joints)
    assert view(writer).load == 1.0
    joints.effort = []
    writer.on_joints(MACHINE, joints)
    assert view(writer).load == 0.0


class ReportingMachine:
    """A scene that shows a machine by its reports and by what is published for it."""

    name = "/site/digger"

    def __init__(self) -> None:
        self.writer = SceneWriter(Scene())

    def report(self, is_pressed: bool, ignored_axes: str = "") -> None:
        values = {"emergency_stop": str(is_pressed), "ignored_axes": ignored_axes}
        entries = [KeyValue(key=f"digger/{key}", value=value) for key, value in values.items()]
        status = DiagnosticStatus(name="site/machine_sim", level=b"\0", values=entries)
        self.writer.on_diagnostics(DiagnosticArray(status=[status]))

    def publish(self, is_pressed: bool) -> None:
        self.writer.on_emergency_stop(self.name, Bool(data=is_pressed))

    @property
    def shown(self) -> tuple[bool | None, bool]:
        gauges = self.writer.scene.machine(self.name).gauges()
        return gauges["stopped"], gauges["stop_requested"]


def test_emergency_stop_is_requested_until_the_machine_reports_it() -> None:
    machine = ReportingMachine()
    machine.report(False)  # before the machine was found
    assert machine.shown == (False, False)
    machine.publish(True)
    assert machine.shown == (False, True)
    machine.report(True)
    assert machine.shown == (True, False)
    machine.publish(True)  # a copy
    machine.publish(False)
    assert machine.shown == (True, False)
    machine.report(False)
    assert machine.shown == (False, False)


def test_machine_that_ignores_levers_is_shown_until_they_count() -> None:
    machine = ReportingMachine()
    view = machine.writer.scene.machine(machine.name)
    for axes in ("axis 4 (joy_left_pedal)", ""):
        machine.report(False, axes)
        assert view.gauges()["levers_ignored"] is bool(axes)


def test_request_of_a_stop_ends_with_its_release_or_with_two_reports_that_deny_it() -> None:
    machine = ReportingMachine()
    assert machine.shown == (None, False)
    for end in (
        lambda: machine.publish(False),
        lambda: machine.report(False),
    ):
        machine.publish(True)
        machine.report(False)  # sent before the machine had received the press
        assert machine.shown == (False, True)
        end()
        assert machine.shown == (False, False)


def test_condition_of_a_node_that_has_ended_is_removed() -> None:
    now = 0.0
    scene = Scene(lambda: now)
    writer = SceneWriter(scene)

    def report(*names: str) -> None:
        status = [DiagnosticStatus(name=name, level=b"\2", message="rejected") for name in names]
        writer.on_diagnostics(DiagnosticArray(status=status))

    report("soil_sim", "other/machine_sim")
    now = 9.0
    report("soil_sim")
    scene.remove_old_conditions(10.0)
    assert scene.status.keys() == {"soil_sim", "other/machine_sim"}
    now = 11.0
    scene.remove_old_conditions(10.0)
    assert scene.status == {"soil_sim": "ERROR: rejected"}


def test_configuration_with_a_huge_number_is_rejected(writer: SceneWriter) -> None:
    with pytest.raises(CodecError):
        writer.on_machine_config(MACHINE, String(data=f"commands: {{joy_deadzone: {10**400}}}"))
