"""An emergency stop while someone drives: nothing moves until the driver released the levers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from viewer.scene.machine_model import MachineModel
from viewer.scene.scene import Scene
from viewer.server.access import AccessPolicy
from viewer.server.backend import Permissions, Source
from viewer.server.encoding import SceneEncoder
from viewer.server.hub import Hub
from viewer.server.page_messages import Drive, EmergencyStop, PageMessage, TakeControl

DRIVER, OTHER = 1, 2
HELD = Drive("/m", ("i",), {})
DEFLECTED = Drive("/m", (), {"right_y": 0.5})
NEUTRAL = Drive("/m", (), {"right_y": 0.0})


class DrivenMachine:
    """A hub with one machine and its driver; the machine reports its stop at once."""

    def __init__(self) -> None:
        self.scene = Scene()
        self.scene.machine("/m").model = MachineModel("m", {}, ())
        self.published: list[dict[str, float]] = []
        backend: Any = SimpleNamespace(
            publish_levers=lambda machine, deflections: self.published.append(dict(deflections)),
            set_emergency_stop=self.scene.set_stop,
        )
        self.hub = Hub(
            AccessPolicy(address="127.0.0.1"),
            server_name="test",
            frame_rate=100.0,
            max_clients=3,
            permissions=Permissions(driving=True),
            live=Source(SceneEncoder(self.scene), "test"),
            backend=backend,
        )
        self.send(DRIVER, TakeControl("/m", False))

    def send(self, number: int, message: PageMessage) -> None:
        client: Any = SimpleNamespace(number=number)
        self.hub.process(client, message)
        self.hub.update()

    def is_moved_by(self, *messages: Drive) -> bool:
        """Return whether anything but released levers is published for messages of the driver."""
        self.published.clear()
        for message in messages:
            self.send(DRIVER, message)
        return any(any(deflections.values()) for deflections in self.published)


@pytest.fixture
def machine() -> DrivenMachine:
    return DrivenMachine()


@pytest.mark.parametrize("levers", [HELD, DEFLECTED])
def test_lever_that_is_held_through_a_stop_of_another_viewer_moves_nothing(
    machine: DrivenMachine, levers: Drive
) -> None:
    assert machine.is_moved_by(levers)
    machine.send(OTHER, EmergencyStop("/m", True))
    assert not any(machine.published[-1].values())
    assert not machine.is_moved_by(levers, levers)
    machine.scene.set_stop("/m", False)  # by a publisher of the topic
    assert not machine.is_moved_by(levers, levers)
    assert not machine.is_moved_by(NEUTRAL)
    assert machine.is_moved_by(levers)


def test_requested_stop_holds_the_levers_before_the_machine_reports_it(
    machine: DrivenMachine,
) -> None:
    machine.scene.request_stop("/m", True)
    assert not machine.is_moved_by(NEUTRAL, HELD)
    machine.scene.set_stop("/m", True)
    machine.scene.set_stop("/m", False)
    assert not machine.is_moved_by(HELD)


def test_levers_that_are_released_only_during_the_stop_move_nothing(
    machine: DrivenMachine,
) -> None:
    machine.send(DRIVER, HELD)
    machine.send(OTHER, EmergencyStop("/m", True))
    assert not machine.is_moved_by(NEUTRAL, HELD)
    machine.scene.set_stop("/m", False)
    assert not machine.is_moved_by(HELD)


def test_stop_by_another_publisher_releases_the_levers_without_a_message_of_the_driver(
    machine: DrivenMachine,
) -> None:
    machine.send(DRIVER, HELD)
    machine.scene.set_stop("/m", True)
    machine.hub.update()
    assert not any(machine.published[-1].values())
    machine.scene.set_stop("/m", False)
    assert not machine.is_moved_by(HELD)
