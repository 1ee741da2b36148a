"""The browser is found, or what to install is named; its command keeps the secret out of `ps`."""

from pathlib import Path

import pytest

from viewer.rendering import browser
from viewer.rendering.browser import Browser, browser_command, find_browser
from viewer.rendering.errors import RenderError
from viewer.rendering.picture import PictureSize

SIZE = PictureSize(640, 360)


@pytest.fixture
def fake_browser(tmp_path, monkeypatch):
    """Return a program in place of the browser: it writes its arguments and ends."""
    program = tmp_path / "browser"
    program.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("CHROMIUM", str(program))
    return program


def test_missing_browser_is_reported_with_what_to_do(monkeypatch, tmp_path):
    monkeypatch.delenv("CHROMIUM", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RenderError, match="make chromium"):
        find_browser()


def test_program_named_by_the_variable_must_exist(monkeypatch):
    monkeypatch.setenv("CHROMIUM", "/no/such/browser")
    with pytest.raises(RenderError, match="/no/such/browser"):
        find_browser()


def test_sandbox_is_off_for_root_only(monkeypatch):
    def command():
        return browser_command("chromium", Path("/profile"), "http://host/", SIZE, gpu=False)

    monkeypatch.setattr(browser.os, "geteuid", lambda: 1000)
    assert "--no-sandbox" not in command()
    monkeypatch.setattr(browser.os, "geteuid", lambda: 0)
    assert "--no-sandbox" in command()


def test_gpu_replaces_drawing_in_software():
    commands = [
        browser_command("chromium", Path("/profile"), "http://host/", SIZE, gpu=gpu)
        for gpu in (False, True)
    ]
    assert [any("swiftshader" in word for word in command) for command in commands] == [True, False]


def test_secret_is_not_in_the_command_line(fake_browser):
    shown = Browser("http://127.0.0.1:1/#token=secret", SIZE)
    try:
        assert shown.process.wait(10.0) == 0
        assert "--user-data-dir" in shown.process.output
        assert "secret" not in shown.process.output
        start = next(Path(shown.process.log).parent.glob("start.html"))
        assert "secret" in start.read_text()
    finally:
        shown.close()
    assert not start.exists()
