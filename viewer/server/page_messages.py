"""Messages of the page: JSON objects with a key `type`, validated field by field.

Only the types below are known. A message that is not exactly one of them is rejected as a whole.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from msg_bridge.contract.errors import EarthmovingError
from teleop.key_layout import CONTROLS, KEYS

__all__ = [
    "MAX_MESSAGE_SIZE",
    "PROTOCOL",
    "Ack",
    "Drive",
    "EmergencyStop",
    "ListBags",
    "Login",
    "PageMessage",
    "Ping",
    "Playback",
    "Record",
    "ReleaseControl",
    "RequestRejectedError",
    "SimulationAction",
    "Speed",
    "TakeControl",
    "parse_page_message",
]

PROTOCOL = 1
"""Version of the protocol."""

MAX_MESSAGE_SIZE = 16_384
"""Maximum size of a message of the page [bytes]."""

_MAX_TEXT = 200
_MAX_ID = 2**53
_MAX_TIME = 1e12  # s
_MAX_HELD_KEYS = len(KEYS)
_MIN_RATE, _MAX_RATE = 0.05, 100.0

_SIMULATION_ACTIONS = ("pause", "continue", "step", "reset")
_PLAYBACK_ACTIONS = ("play", "pause", "seek", "rate")


class RequestRejectedError(EarthmovingError):
    """A message of a page is rejected.

    Attributes:
        code: reason, for programs.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(frozen=True)
class Login:
    """First message of a client. `bag` is the name of a bag, None for the default source."""

    token: str
    protocol: int
    bag: str | None


@dataclass(frozen=True)
class Ack:
    """The page has applied the frame `seq`."""

    seq: int


@dataclass(frozen=True)
class TakeControl:
    """Take the levers of a machine; with `force` also from another client."""

    machine: str
    force: bool


@dataclass(frozen=True)
class ReleaseControl:
    """Release the levers."""


@dataclass(frozen=True)
class Drive:
    """Keys that are held, and deflections of further controls, -1 to 1.

    `time` is that of the message by the clock of the client [s]; None if it gives none.
    """

    machine: str
    held: tuple[str, ...]
    deflections: dict[str, float]
    time: float | None = None


@dataclass(frozen=True)
class Speed:
    """Full deflection of a held key, 0.1 to 1."""

    value: float


@dataclass(frozen=True)
class EmergencyStop:
    """Press or release the emergency stop of a machine."""

    machine: str
    pressed: bool


@dataclass(frozen=True)
class SimulationAction:
    """pause, continue, step or reset."""

    action: str


@dataclass(frozen=True)
class Record:
    """Start or stop a recording."""

    on: bool


@dataclass(frozen=True)
class Playback:
    """Control of a bag: play, pause, seek to a time [s] or set the rate."""

    action: str
    value: float


@dataclass(frozen=True)
class ListBags:
    """Request the names of the bags."""


@dataclass(frozen=True)
class Ping:
    """Request a `pong` with the same id."""

    id: int


PageMessage = (
    Login | Ack | TakeControl | ReleaseControl | Drive | Speed | EmergencyStop | SimulationAction
    | Record | Playback | ListBags | Ping
)  # fmt: skip


def parse_page_message(text: str) -> PageMessage:
    """Return the message in a text.

    Raises:
        RequestRejectedError: it is no known message, or a field is missing, unknown or invalid.
    """
    if len(text) > MAX_MESSAGE_SIZE:
        raise RequestRejectedError("too_large", f"a message has at most {MAX_MESSAGE_SIZE} bytes")
    try:
        found = json.loads(text, parse_constant=_reject_constant)
    except (ValueError, RecursionError):
        raise RequestRejectedError("not_json", "a message must be a JSON object") from None
    if not isinstance(found, dict):
        raise RequestRejectedError("not_json", "a message must be a JSON object")
    fields = _Fields(found)
    kind = fields.text("type")
    parse = _PARSERS.get(kind)
    if parse is None:
        raise RequestRejectedError("unknown_type", f"there is no message {kind[:40]!r}")
    message = parse(fields)
    fields.check_all_used()
    return message


class _Fields:
    """Fields of a message, each read once."""

    def __init__(self, values: dict[str, Any]) -> None:
        self._values = values
        self._used: set[str] = set()

    def text(self, name: str) -> str:
        value = self._take(name)
        if not isinstance(value, str) or len(value) > _MAX_TEXT:
            raise _invalid(name, f"a text of at most {_MAX_TEXT} characters")
        if any("\ud800" <= each <= "\udfff" for each in value):
            raise _invalid(name, "a text without surrogates")
        return value

    def choice(self, name: str, choices: tuple[str, ...]) -> str:
        value = self.text(name)
        if value not in choices:
            raise _invalid(name, f"one of {', '.join(choices)}")
        return value

    def optional_number(self, name: str, low: float, high: float) -> float | None:
        return self.number(name, low, high) if name in self._values else None

    def number(self, name: str, low: float, high: float) -> float:
        value = self._take(name)
        if not _is_number(value) or not low <= value <= high:
            raise _invalid(name, f"a number from {low:g} to {high:g}")
        return float(value)

    def integer(self, name: str) -> int:
        value = self._take(name)
        if type(value) is not int or not 0 <= value <= _MAX_ID:
            raise _invalid(name, "a whole number from 0")
        return value

    def boolean(self, name: str, *, default: bool | None = None) -> bool:
        if default is not None and name not in self._values:
            return default
        value = self._take(name)
        if not isinstance(value, bool):
            raise _invalid(name, "true or false")
        return value

    def raw(self, name: str) -> Any:
        return self._take(name)

    def check_all_used(self) -> None:
        unknown = sorted(set(self._values) - self._used)
        if unknown:
            raise RequestRejectedError(
                "unknown_field", f"the message has no field {unknown[0][:40]!r}"
            )

    def _take(self, name: str) -> Any:
        self._used.add(name)
        if name not in self._values:
            raise RequestRejectedError("missing_field", f"the field {name!r} is missing")
        return self._values[name]


def _login(fields: _Fields) -> Login:
    token, protocol, source = fields.text("token"), fields.integer("protocol"), fields.raw("source")
    if source == "live":
        return Login(token, protocol, None)
    if isinstance(source, dict) and set(source) == {"bag"}:
        return Login(token, protocol, _Fields(source).text("bag"))
    raise _invalid("source", '"live" or {"bag": NAME}')


def _drive(fields: _Fields) -> Drive:
    machine, held = fields.text("machine"), fields.raw("held")
    deflections = fields.raw("deflections")
    if (
        not isinstance(held, list)
        or len(held) > _MAX_HELD_KEYS
        or not all(isinstance(key, str) and key in KEYS for key in held)
    ):
        raise _invalid("held", f"a list of keys: {', '.join(KEYS)}")
    if not isinstance(deflections, dict) or not all(
        name in CONTROLS and _is_number(value) and -1.0 <= value <= 1.0
        for name, value in deflections.items()
    ):
        raise _invalid("deflections", f"numbers from -1 to 1 of {', '.join(CONTROLS)}")
    values = {name: float(value) for name, value in deflections.items()}
    time = fields.optional_number("time", -_MAX_TIME, _MAX_TIME)
    return Drive(machine, tuple(dict.fromkeys(held)), values, time)


def _playback(fields: _Fields) -> Playback:
    action = fields.choice("action", _PLAYBACK_ACTIONS)
    if action == "seek":
        return Playback(action, fields.number("value", 0.0, 1e9))
    if action == "rate":
        return Playback(action, fields.number("value", _MIN_RATE, _MAX_RATE))
    return Playback(action, 0.0)


_PARSERS: dict[str, Callable[[_Fields], PageMessage]] = {
    "login": _login,
    "ack": lambda fields: Ack(fields.integer("seq")),
    "take_control": lambda fields: TakeControl(
        fields.text("machine"), fields.boolean("force", default=False)
    ),
    "release_control": lambda fields: ReleaseControl(),
    "drive": _drive,
    "speed": lambda fields: Speed(fields.number("value", 0.1, 1.0)),
    "emergency_stop": lambda fields: EmergencyStop(
        fields.text("machine"), fields.boolean("pressed")
    ),
    "simulation": lambda fields: SimulationAction(fields.choice("action", _SIMULATION_ACTIONS)),
    "record": lambda fields: Record(fields.boolean("on")),
    "playback": _playback,
    "list_bags": lambda fields: ListBags(),
    "ping": lambda fields: Ping(fields.integer("id")),
}


def _is_number(value: Any) -> bool:
    """Return whether a value is a finite number; a JSON integer may be too large for a float."""
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, int) and not isinstance(value, bool)


def _invalid(name: str, wanted: str) -> RequestRejectedError:
    return RequestRejectedError("invalid_field", f"the field {name!r} must be {wanted}")


def _reject_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON number")
