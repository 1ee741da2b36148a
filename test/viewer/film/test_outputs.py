"""Outputs of a film: encoded files that can be played, and pictures in a folder."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from viewer.film import encoder
from viewer.film.encoder import VideoEncoder, encoder_command, find_ffmpeg
from viewer.film.outputs import check_output, open_output
from viewer.rendering.errors import RenderError
from viewer.rendering.picture import PictureSize

SIZE = PictureSize(64, 48)
MP4 = Path("film.mp4")


def frame(brightness):
    return np.full((48, 64, 3), brightness, dtype=np.uint8)


def count_frames(path):
    """Return the number of frames that ffmpeg decodes from a file."""
    command = [find_ffmpeg(), "-hide_banner", "-i", str(path), "-f", "null", "-"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return int(re.findall(r"frame=\s*(\d+)", done.stderr)[-1])


def test_mp4_has_all_frames_and_the_pixel_format_that_all_players_read(tmp_path):
    path = tmp_path / "film.mp4"
    with VideoEncoder(path, SIZE, 25.0) as video:
        for brightness in range(0, 250, 50):
            video.write(frame(brightness))
    assert count_frames(path) == 5
    command = [find_ffmpeg(), "-hide_banner", "-i", str(path)]
    text = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    assert "h264" in text
    assert "yuv420p" in text
    assert "64x48" in text


def test_webp_is_animated(tmp_path):
    path = tmp_path / "film.webp"
    with VideoEncoder(path, SIZE, 10.0) as video:
        for brightness in (0, 100, 200):
            video.write(frame(brightness))
    with Image.open(path) as image:
        assert (image.n_frames, image.size) == (3, (64, 48))


def interrupted_film(path):
    """Write seven frames; then Ctrl-C."""
    with VideoEncoder(path, SIZE, 25.0) as video:
        for _ in range(7):
            video.write(frame(80))
        raise KeyboardInterrupt


def test_film_that_is_interrupted_can_be_played_up_to_there(tmp_path):
    path = tmp_path / "film.mp4"
    with pytest.raises(KeyboardInterrupt):
        interrupted_film(path)
    assert count_frames(path) == 7


def write_many_frames(path):
    with VideoEncoder(path, SIZE, 25.0) as video:
        for _ in range(1000):
            video.write(frame(1))


def test_encoder_that_fails_is_reported_with_its_message(tmp_path):
    with pytest.raises(RenderError, match="No such file"):
        write_many_frames(tmp_path / "missing" / "film.mp4")


def test_frame_of_another_size_is_rejected(tmp_path):
    with VideoEncoder(tmp_path / "film.mp4", SIZE, 25.0) as video:
        video.write(frame(0))
        with pytest.raises(RenderError):
            video.write(frame(0)[:-1])


def test_odd_size_is_rejected_for_mp4_only():
    odd = PictureSize(65, 48)
    with pytest.raises(RenderError, match="even"):
        encoder_command("ffmpeg", odd, 25.0, "high", MP4)
    assert "libwebp_anim" in encoder_command("ffmpeg", odd, 25.0, "high", Path("film.webp"))


def test_better_quality_is_a_smaller_rate_factor():
    def factor(quality):
        command = encoder_command("ffmpeg", SIZE, 25.0, quality, MP4)
        return int(command[command.index("-crf") + 1])

    assert factor("high") < factor("medium") < factor("low")


def test_missing_ffmpeg_is_reported_with_what_to_install(monkeypatch, tmp_path):
    def fail(name):
        raise ImportError(name)

    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(encoder.importlib, "import_module", fail)
    with pytest.raises(RenderError, match="imageio-ffmpeg"):
        find_ffmpeg()


def test_folder_gets_numbered_pictures(tmp_path):
    folder = tmp_path / "frames"
    check_output(folder, SIZE, is_picture=False)
    with open_output(folder, SIZE, 25.0, "high") as output:
        output.write(frame(10))
        output.write(frame(20))
    assert sorted(path.name for path in folder.iterdir()) == ["frame_00001.png", "frame_00002.png"]
    with Image.open(folder / "frame_00002.png") as image:
        assert image.getpixel((0, 0)) == (20, 20, 20)


@pytest.mark.parametrize(
    ("name", "is_picture"), [("film.mp4", True), ("film.png", False), ("film.avi", False)]
)
def test_output_that_does_not_suit_is_rejected(tmp_path, name, is_picture):
    with pytest.raises(RenderError):
        check_output(tmp_path / name, SIZE, is_picture=is_picture)


@pytest.mark.parametrize(("name", "is_folder"), [("frames", False), ("film.png", True)])
def test_file_in_place_of_a_folder_is_rejected_and_the_reverse(tmp_path, name, is_folder):
    path = tmp_path / name
    if is_folder:
        path.mkdir()
    else:
        path.write_text("mine")
    with pytest.raises(RenderError, match="is a "):
        check_output(path, SIZE, is_picture=is_folder)


def test_picture_that_cannot_be_saved_is_an_error_of_the_film(tmp_path):
    folder = tmp_path / "frames"
    (folder / "frame_00001.png").mkdir(parents=True)
    with open_output(folder, SIZE, 25.0, "high") as output, pytest.raises(RenderError):
        output.write(frame(10))
