"""Browser: Chromium without a window, which draws the page."""

from __future__ import annotations

import html
import os
import shutil
import signal
import tempfile
from pathlib import Path

from msg_bridge.processes import ChildProcess, python_module_command
from viewer.rendering.errors import RenderError
from viewer.rendering.picture import PictureSize

__all__ = ["BROWSER_NAMES", "Browser", "browser_command", "find_browser"]

BROWSER_NAMES = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
)
"""Names under which the browser is looked for on the PATH."""

_SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""WebGL 2 on the CPU."""

_GPU = ("--ignore-gpu-blocklist", "--enable-gpu")

_ARGUMENTS = (
    "--headless=new",
    "--no-first-run",
    "--no-default-browser-check",
    "--disable-extensions",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-background-timer-throttling",
    "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows",
    "--disable-dev-shm-usage",  # containers often have a small one
    "--hide-scrollbars",
    "--mute-audio",
    "--force-color-profile=srgb",
    "--force-device-scale-factor=1",
)

_LOG_LINES = 8
"""Number of lines of the browser's output that an error shows."""

_EXIT_TIME = 5.0
"""Wall time that the browser has to end after the signal [s]."""


def find_browser() -> str:
    """Return the path of the browser: that of the variable CHROMIUM, or one on the PATH.

    Raises:
        RenderError: there is none.
    """
    named = os.environ.get("CHROMIUM")
    names = (named,) if named else BROWSER_NAMES
    for name in names:
        path = shutil.which(name)
        if path is not None:
            return path
    missing = f"CHROMIUM={named} is no program" if named else "there is no Chromium or Chrome"
    raise RenderError(
        f"{missing}, which draws the pictures. Run `make chromium` in the source folder, or"
        " `apt install chromium`, or set CHROMIUM to the path of a Chromium or Chrome"
    )


def browser_command(
    program: str, profile: Path, url: str, size: PictureSize, *, gpu: bool
) -> list[str]:
    """Return the command that shows a page without a window.

    Args:
        program: path of the browser.
        profile: empty folder for its profile.
        url: address of the page.
        size: size of the window.
        gpu: draw with the GPU; else on the CPU.
    """
    # As root Chromium does not start with its sandbox. It shows only the page of this program.
    sandbox = ("--no-sandbox",) if os.geteuid() == 0 else ()
    return [
        program,
        *_ARGUMENTS,
        *(_GPU if gpu else _SOFTWARE),
        *sandbox,
        f"--window-size={size.width},{size.height}",
        f"--user-data-dir={profile}",
        url,
    ]


class Browser:
    """A browser that shows one page, without a window; it ends with this process.

    Attributes:
        process: the running program.
    """

    def __init__(self, url: str, size: PictureSize, *, gpu: bool = False) -> None:
        """
        Args:
            url: address of the page. It may contain a secret: it does not appear in the command,
                which other users can read.
            size: size of the window.
            gpu: draw with the GPU; else on the CPU.

        Raises:
            RenderError: there is no browser.
        """
        program = find_browser()
        self._folder = tempfile.TemporaryDirectory(
            prefix="earthmoving_browser_", ignore_cleanup_errors=True
        )
        folder = Path(self._folder.name)  # readable for this user only
        start = folder / "start.html"
        target = html.escape(f"0;url={url}", quote=True)
        start.write_text(
            f'<!doctype html><meta http-equiv="refresh" content="{target}">', encoding="utf-8"
        )
        command = browser_command(program, folder / "profile", start.as_uri(), size, gpu=gpu)
        environment = {"HOME": self._folder.name} if not os.environ.get("HOME") else {}
        launcher = python_module_command("msg_bridge.processes.exec_program", command)
        self.process = ChildProcess(launcher, folder / "browser.log", env=environment)

    @property
    def has_ended(self) -> bool:
        """Whether the program runs no longer."""
        return self.process.exit_code is not None

    def log_tail(self) -> str:
        """Return the last lines of its output, indented, without those on a missing D-Bus."""
        lines = [line for line in self.process.output.splitlines() if ":dbus/" not in line]
        return "\n".join(f"    {line}" for line in lines[-_LOG_LINES:])

    def close(self) -> None:
        """End the program and all its processes, and remove its profile."""
        if not self.has_ended:
            self.process.interrupt(signal.SIGTERM)
            self.process.wait(_EXIT_TIME)
        self.process.kill()
        self._folder.cleanup()
