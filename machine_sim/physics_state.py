"""Physics clients, and their state as bytes: positions and velocities of all bodies.

pybullet writes contacts too, but does not restore all of them: bodies that touch move differently
afterwards. So a state with contacts is rejected, such as that of any machine with dynamic tracks,
whose shoes touch its wheels.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pybullet

from machine_sim.machine.errors import MachineError

__all__ = ["PhysicsClient", "dump_physics", "next_client", "restore_physics"]

_MAX_CLIENTS = 64


class PhysicsClient:
    """A physics client without a window, which ends with the last object that refers to it.

    Attributes:
        id: its id.
    """

    def __init__(self) -> None:
        self.id: int = pybullet.connect(pybullet.DIRECT)
        self._disconnect = weakref.finalize(self, pybullet.disconnect, self.id)

    def close(self) -> None:
        """End the client now, and release its memory."""
        self._disconnect()


def dump_physics(client: int, *, allow_contacts: bool = False) -> bytes:
    """Return the state of a client.

    Args:
        client: its id.
        allow_contacts: whether bodies may touch one another; they move differently then after
            `restore_physics`.

    Raises:
        MachineError: bodies touch one another.
    """
    if not allow_contacts and pybullet.getContactPoints(physicsClientId=client):
        raise MachineError(
            "bodies of the machines touch one another, and pybullet does not restore contacts"
            " exactly: machines that touch, or dynamic tracks; save at another tick, or not with"
            " dynamic tracks"
        )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state.bullet"
        pybullet.saveBullet(str(path), physicsClientId=client)
        return path.read_bytes()


def restore_physics(client: int, data: bytes) -> None:
    """Give a client the state of another one that has the same bodies, made in the same order.

    Commands of motors and forces are not part of it: a machine sets them in each step.

    Args:
        client: its id.
        data: the state.

    Raises:
        pybullet.error: the bodies are others.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state.bullet"
        path.write_bytes(data)
        pybullet.restoreState(fileName=str(path), physicsClientId=client)


@contextmanager
def next_client(client: int) -> Iterator[None]:
    """Let the next client that is made in this context have an id, which objects know it by.

    Raises:
        ValueError: the id is taken.
    """
    fillers = []
    try:
        while (made := pybullet.connect(pybullet.DIRECT)) < client and made < _MAX_CLIENTS:
            fillers.append(made)
        pybullet.disconnect(made)
        if made != client:
            raise ValueError(f"the physics client {client} is in use")
        yield
    finally:
        for each in fillers:
            pybullet.disconnect(each)
