"""Only messages that are known and complete are carried out."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from viewer.server.page_messages import (
    MAX_MESSAGE_SIZE,
    Drive,
    Login,
    Playback,
    RequestRejectedError,
    TakeControl,
    parse_page_message,
)

DRIVE = {"type": "drive", "machine": "/m", "held": ["w", "i"], "deflections": {"left_x": -0.5}}


def code_of(message: object) -> str:
    text = message if isinstance(message, str) else json.dumps(message)
    with pytest.raises(RequestRejectedError) as caught:
        parse_page_message(text)
    return caught.value.code


def test_messages_are_read() -> None:
    drive = Drive("/m", ("w", "i"), {"left_x": -0.5})
    assert parse_page_message(json.dumps(DRIVE)) == drive
    assert parse_page_message(json.dumps({**DRIVE, "time": 2.5})) == replace(drive, time=2.5)
    login = {"type": "login", "token": "t", "protocol": 1, "source": {"bag": "b"}}
    assert parse_page_message(json.dumps(login)) == Login("t", 1, "b")
    take = {"type": "take_control", "machine": "/m"}
    assert parse_page_message(json.dumps(take)) == TakeControl("/m", force=False)
    seek = {"type": "playback", "action": "seek", "value": 3}
    assert parse_page_message(json.dumps(seek)) == Playback("seek", 3.0)


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("[]", "not_json"),
        ("{", "not_json"),
        ("[" * 5000, "not_json"),
        ('{"type": "speed", "value": NaN}', "not_json"),
        ('{"type": "speed", "value": 1e999}', "invalid_field"),
        ("x" * (MAX_MESSAGE_SIZE + 1), "too_large"),
        ({}, "missing_field"),
        ({"type": "eval"}, "unknown_type"),
        ({"type": ["drive"]}, "invalid_field"),
        ({"type": "ping"}, "missing_field"),
        ({"type": "ping", "id": True}, "invalid_field"),
        ({"type": "ping", "id": -1}, "invalid_field"),
        ({"type": "ping", "id": 1, "x": 1}, "unknown_field"),
        ({"type": "speed", "value": "1"}, "invalid_field"),
        ({"type": "speed", "value": 0.05}, "invalid_field"),
        ({"type": "speed", "value": 10**400}, "invalid_field"),
        ({"type": "emergency_stop", "machine": "/m", "pressed": 1}, "invalid_field"),
        ({"type": "simulation", "action": "shutdown"}, "invalid_field"),
        ({"type": "playback", "action": "rate", "value": 0}, "invalid_field"),
        ({"type": "playback", "action": "seek"}, "missing_field"),
        ({"type": "login", "token": "", "protocol": 1, "source": {"file": "x"}}, "invalid_field"),
        ({**DRIVE, "held": ["rm -rf"]}, "invalid_field"),
        ({**DRIVE, "held": ["w"] * 100}, "invalid_field"),
        ({**DRIVE, "held": "w"}, "invalid_field"),
        ({**DRIVE, "deflections": {"left_x": 1.5}}, "invalid_field"),
        ({**DRIVE, "deflections": {"left_x": -(10**400)}}, "invalid_field"),
        ({**DRIVE, "deflections": {"nose": 0.5}}, "invalid_field"),
        ({**DRIVE, "deflections": []}, "invalid_field"),
        ({**DRIVE, "machine": "m" * 300}, "invalid_field"),
        ({**DRIVE, "machine": "\ud800"}, "invalid_field"),
    ],
)
def test_other_messages_are_rejected(message: object, code: str) -> None:
    assert code_of(message) == code
