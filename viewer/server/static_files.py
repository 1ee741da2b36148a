"""Files of the page: those in its folder when the server starts, and no other path."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

__all__ = ["MISSING_PAGE", "PAGE_FOLDER", "StaticFile", "find_files"]

PAGE_FOLDER = Path(__file__).parents[1] / "page" / "dist"
"""Folder of the built page."""

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".json": "application/json",
    ".map": "application/json",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".webp": "image/webp",
    ".ico": "image/x-icon",
    ".woff2": "font/woff2",
    ".glb": "model/gltf-binary",
    ".wasm": "application/wasm",
    ".txt": "text/plain; charset=utf-8",
}

MISSING_PAGE = """\
<!doctype html><meta charset="utf-8"><title>earthmoving_sim viewer</title>
<p>The page is not built. Run <code>python viewer/page/build_page.py</code> in the source folder and
start the viewer again. The stream on <code>/stream</code> works without the page.
"""


class StaticFile(NamedTuple):
    """A file of the page: its path and content type."""

    path: Path
    content_type: str


def find_files(folder: Path) -> dict[str, StaticFile]:
    """Return the files of a folder by their path in a URL; `/` is index.html.

    Links and files of unknown types are left out.
    """
    files = {
        f"/{path.relative_to(folder).as_posix()}": StaticFile(path, _TYPES[path.suffix])
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.is_symlink() and path.suffix in _TYPES
    }
    if "/index.html" in files:
        files["/"] = files["/index.html"]
    return files
