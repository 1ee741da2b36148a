"""VideoEncoder: an MP4 (H.264) or an animated WebP from pictures, by ffmpeg."""

from __future__ import annotations

import contextlib
import importlib
import shutil
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from viewer.rendering.errors import RenderError
from viewer.rendering.picture import PictureSize

__all__ = ["VIDEO_SUFFIXES", "VideoEncoder", "encoder_command", "find_ffmpeg"]

VIDEO_SUFFIXES = (".mp4", ".webp")

_CRF = {"low": 28, "medium": 23, "high": 19}
"""Constant rate factor of x264 by quality; smaller is better and larger in bytes."""

_WEBP_QUALITY = {"low": 40, "medium": 55, "high": 70}
"""Quality of WebP, 0 to 100, by quality."""

_END_TIME = 60.0
"""Wall time that the encoder has to write its last frames [s]."""


def find_ffmpeg() -> str:
    """Return the path of ffmpeg: on the PATH, or that of the Python package imageio-ffmpeg.

    Raises:
        RenderError: there is none.
    """
    path = shutil.which("ffmpeg")
    if path is not None:
        return path
    with contextlib.suppress(ImportError, RuntimeError):
        found: str = importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
        return found
    raise RenderError(
        "ffmpeg, which writes MP4 and WebP files, is missing: `apt install ffmpeg`, or"
        " `pip install imageio-ffmpeg`; or write PNG files: give a folder as output"
    )


def encoder_command(
    program: str, size: PictureSize, rate: float, quality: str, path: Path
) -> list[str]:
    """Return the command that encodes RGB pictures from its standard input.

    Args:
        program: path of ffmpeg.
        size: of the pictures, for MP4 even in both directions.
        rate: frames per second.
        quality: low, medium or high.
        path: the file to write; its suffix is one of `VIDEO_SUFFIXES`.

    Raises:
        RenderError: the size is odd.
    """
    head = [
        program,
        *("-hide_banner", "-loglevel", "error", "-y"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", str(size), "-r", f"{rate:g}", "-i", "-"),
        "-an",
    ]
    if path.suffix == ".webp":
        quality_options = ("-quality", str(_WEBP_QUALITY[quality]), "-compression_level", "5")
        return [*head, "-c:v", "libwebp_anim", *quality_options, "-loop", "0", str(path)]
    if size.width % 2 or size.height % 2:
        raise RenderError(f"an MP4 needs an even width and height, not {size}")
    return [
        *head,
        *("-c:v", "libx264", "-preset", "medium", "-crf", str(_CRF[quality])),
        # BT.709 named in the file: players would take another matrix for some sizes.
        *("-vf", "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"),
        *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"),
        *("-movflags", "+faststart", "-f", "mp4"),
        str(path),
    ]


class VideoEncoder:
    """Writes a film; a context manager, whose end completes the file.

    The file is playable whenever the context is left, also by an error or Ctrl-C.
    """

    def __init__(self, path: Path, size: PictureSize, rate: float, quality: str = "high") -> None:
        """
        Args:
            path: the file to write; it is replaced.
            size: of the pictures, for MP4 even in both directions.
            rate: frames per second.
            quality: low, medium or high.

        Raises:
            RenderError: ffmpeg is missing, or the size is odd.
        """
        self.path, self.size = path, size
        command = encoder_command(find_ffmpeg(), size, rate, quality, path)
        self._log = tempfile.TemporaryFile()  # noqa: SIM115
        # A session of its own: Ctrl-C ends the film, and the encoder then completes the file.
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def write(self, pixels: NDArray[np.uint8]) -> None:
        """Append a frame: red, green, blue, shape (height, width, 3).

        Raises:
            RenderError: the encoder has ended.
        """
        if pixels.shape != (self.size.height, self.size.width, 3):
            raise RenderError(f"a frame of {self.size} pixels has not the shape {pixels.shape}")
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(pixels).data)
        except BrokenPipeError:
            raise RenderError(self._problem()) from None

    def close(self) -> None:
        """Complete the file.

        Raises:
            RenderError: the encoder has failed.
        """
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            code = self._process.wait(_END_TIME)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        problem = self._problem() if code else ""
        self._log.close()
        if problem:
            raise RenderError(problem)

    def __enter__(self) -> VideoEncoder:
        """Return the encoder."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Complete the file."""
        if error is None:
            self.close()
            return
        with contextlib.suppress(RenderError):
            self.close()

    def _problem(self) -> str:
        self._log.seek(0)
        text = self._log.read().decode(errors="replace").strip()[-500:]
        return f"ffmpeg cannot write {self.path}: {text or 'it has ended'}"
