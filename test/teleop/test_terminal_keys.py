"""Keys that are held, from the bytes of terminals with and without reports of releases."""

from __future__ import annotations

import pytest

from teleop.terminal_keys import TerminalKeys

KITTY = b"\x1b[?11u"  # answer of a terminal that reports releases


def test_key_without_release_is_held_until_its_repetitions_end() -> None:
    keys = TerminalKeys()
    assert keys.feed(b"w", 0.0) == ["w"]
    assert keys.held(0.45) == {"w"}
    assert keys.feed(b"w", 0.45) == []  # the terminal repeats it
    assert keys.held(0.6) == {"w"}
    assert keys.held(0.7) == set()
    assert keys.feed(b"w", 0.8) == ["w"]


def test_reported_keys_are_held_until_their_release() -> None:
    keys = TerminalKeys()
    keys.feed(KITTY, 0.0)
    assert keys.has_releases
    assert keys.feed(b"\x1b[119u\x1b[105;1:1u\x1b[119;1:2u", 0.0) == ["w", "i"]
    for answer in range(1, 200):
        keys.feed(KITTY, 0.3 * answer)
    assert keys.held(60.0) == {"w", "i"}
    keys.feed(b"\x1b[119;1:3u", 60.0)
    assert keys.held(60.0) == {"i"}


def test_keys_are_released_when_the_terminal_is_silent_until_pressed_again() -> None:
    keys = TerminalKeys()
    keys.feed(KITTY + b"\x1b[119u\x1b[105u", 0.0)
    keys.feed(b"\x1b[105;1:2u", 0.4)  # the last key is repeated
    assert keys.held(0.8) == {"w", "i"}
    assert keys.held(1.0) == set()
    assert keys.feed(b"\x1b[105;1:2u", 2.0) == []
    assert keys.held(2.0) == set()
    assert keys.feed(b"\x1b[105;1:3u\x1b[105u", 2.1) == ["i"]
    assert keys.held(2.1) == {"i"}


@pytest.mark.parametrize("sequence", [b"\x1b[A", b"\x1bOA", b"\x1b[1;1A", b"\x1b[1;1:1A"])
def test_arrows(sequence: bytes) -> None:
    assert TerminalKeys().feed(sequence, 0.0) == ["up"]


def test_sequence_may_arrive_in_parts() -> None:
    keys = TerminalKeys()
    parts = [keys.feed(bytes([byte]), 0.0) for byte in KITTY + b"\x1b[119u\x1b[119;1:3ud"]
    assert [key for part in parts for key in part] == ["w", "d"]
    assert keys.held(0.0) == {"d"}


def test_lost_focus_releases_all_keys() -> None:
    keys = TerminalKeys()
    keys.feed(KITTY + b"\x1b[119u", 0.0)
    keys.feed(b"\x1b[O", 1.0)
    assert keys.held(1.0) == set()
    assert keys.feed(b"\x1b[I\x1b[119;1:2u", 1.1) == []
    assert keys.held(1.1) == set()


@pytest.mark.parametrize("interrupt", [b"\x03", b"\x1b[99;5u"])
def test_interrupt_quits(interrupt: bytes) -> None:
    assert TerminalKeys().feed(interrupt, 0.0) == ["q"]


def test_arbitrary_bytes_are_read_without_error() -> None:
    keys = TerminalKeys()
    for first in range(256):
        keys.feed(bytes([first, 27, 91, 255, 59, 58, 117]) + b"\x1b[;:3u\x1b[99999999999u", 0.0)
    assert keys.feed(b"w", 10.0) == ["w"]
