"""What the server needs of what it shows: a live simulation, or bags."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from viewer.server.encoding import SceneEncoder

__all__ = [
    "BagLibrary",
    "LiveBackend",
    "Permissions",
    "PlaybackControl",
    "Recording",
    "Reply",
    "Source",
    "Timeline",
]

Reply = Callable[[str], None]
"""Called in any thread with the reason why a request has failed; not called if it has succeeded."""


@dataclass(frozen=True)
class Permissions:
    """What clients may do.

    Attributes:
        driving: drive machines, and release an emergency stop; everyone may press it.
        simulation_control: pause, continue, step and reset.
        recording: start and stop a recording.
    """

    driving: bool = False
    simulation_control: bool = False
    recording: bool = False


class Recording(NamedTuple):
    """A recording.

    Attributes:
        on: whether it runs.
        path: its folder; empty before the first recording.
        num_bytes: its size [bytes].
        failure: why it has ended without a request; empty if it has not.
    """

    on: bool
    path: str
    num_bytes: int
    failure: str = ""


class LiveBackend(Protocol):
    """The requests that a running simulation takes; all return at once."""

    def publish_levers(self, machine: str, deflections: Mapping[str, float]) -> None:
        """Publish the deflections of the controls of a machine."""

    def set_emergency_stop(self, machine: str, pressed: bool) -> None:
        """Press or release the emergency stop of a machine."""

    def control_simulation(self, action: str, reply: Reply) -> None:
        """Pause, continue, step or reset."""

    def record(self, on: bool, reply: Reply) -> None:
        """Start or stop a recording."""

    def recording(self) -> Recording:
        """Return the present recording, or the last one."""


class Timeline(NamedTuple):
    """Position of a player: start, end and time [s], rate, and whether it is paused."""

    start: float
    end: float
    time: float
    rate: float
    paused: bool


class PlaybackControl(Protocol):
    """A player of one bag; all requests return at once."""

    def play(self) -> None:
        """Continue."""

    def pause(self) -> None:
        """Stand still."""

    def seek(self, time: float) -> None:
        """Go to a time [s] from the start."""

    def set_rate(self, rate: float) -> None:
        """Set the rate, 1 is real time."""

    def timeline(self) -> Timeline:
        """Return the present position."""

    def failure(self) -> str:
        """Return why the player has ended; empty while it runs."""

    def close(self) -> None:
        """End the player."""


@dataclass(frozen=True)
class Source:
    """What one client is shown.

    Attributes:
        encoder: of its scene.
        title: name for the user.
        player: control of the bag; None for a live simulation.
    """

    encoder: SceneEncoder
    title: str
    player: PlaybackControl | None = None


class BagLibrary(Protocol):
    """The bags that clients may open."""

    def names(self) -> list[str]:
        """Return their names."""

    def open(self, name: str) -> Source:
        """Return a player of its own for a bag.

        Raises:
            EarthmovingError: there is no such bag, or it cannot be read.
        """
