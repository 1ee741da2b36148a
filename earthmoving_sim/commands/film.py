"""Make a film, or a picture, of a recording: drawn by the live page, without a window.

OUT.mp4 is a film (H.264), OUT.webp an animated picture, OUT.png with --at one picture, and a folder
gets one PNG for each frame. Chromium draws, on the CPU unless --gpu is given; `make chromium`
installs it. Ctrl-C ends the film early; the file is complete up to there.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from earthmoving_sim.option_checks import reject_options
from msg_bridge.contract.errors import EarthmovingError

if TYPE_CHECKING:  # light at import, so that `--help` is quick
    from viewer.rendering.camera import MachineCamera

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "make a film or a picture of a bag"

_VIEWS = ("orbit", "cab", "top", "bucket")
_QUALITIES = ("low", "medium", "high")
_FOLDER = Path("out/film")
_RATE = 25.0  # frames per second
_SPEED = 2.0  # simulated seconds per second of the film


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `earthmoving film`."""
    parser.add_argument("bag", type=Path, help="folder of a bag, or an .mcap file")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="OUT",
        help="film OUT.mp4 or OUT.webp, picture OUT.png with --at, or a folder for PNG files"
        " (default: out/film/<name of the bag>.mp4, or .png with --at)",
    )
    parser.add_argument(
        "--camera", choices=_VIEWS, default="orbit", help="view (default: %(default)s)"
    )
    parser.add_argument(
        "--orbit",
        metavar="AZ,EL,DIST",
        help="direction [deg], 0 along +x and 90 along +y; elevation [deg] and distance [m] of the"
        " camera from the machine; a value that is left out keeps its default",
    )
    parser.add_argument(
        "--fov", type=float, metavar="DEG", help="vertical angle of view (default: the view's)"
    )
    parser.add_argument(
        "--machine",
        default="",
        metavar="NAME",
        help="namespace of the machine to follow (default: the first one)",
    )
    parser.add_argument("--start", type=float, metavar="S", help="begin after this time [s] (0)")
    parser.add_argument(
        "--end", type=float, metavar="S", help="end at this time [s] (default: the end of the bag)"
    )
    parser.add_argument(
        "--at",
        type=_picture_time,
        metavar="S",
        help="one picture at this time [s], or at the `end`, instead of a film",
    )
    parser.add_argument("--fps", type=float, help=f"frames per second ({_RATE:g})")
    parser.add_argument(
        "--speed", type=float, help=f"simulated seconds per second of the film ({_SPEED:g})"
    )
    parser.add_argument(
        "--size", default="1280x720", metavar="WxH", help="size in pixels (default: %(default)s)"
    )
    parser.add_argument(
        "--quality",
        choices=_QUALITIES,
        default="high",
        help="detail of the picture and of the encoding (default: %(default)s)",
    )
    parser.add_argument(
        "--overlay", action="store_true", help="write time, speed and payload into the picture"
    )
    parser.add_argument("--gpu", action="store_true", help="draw with the GPU")


def run(args: argparse.Namespace) -> int:
    """Make the film or picture; return 0."""
    from viewer.film.film import FilmRequest, make_film
    from viewer.rendering.picture import PictureSize

    if args.at is not None:
        reason = "is for a film, and --at for one picture; give one of them"
        reject_options(args, ("start", "end", "fps", "speed"), reason)
    request = FilmRequest(
        bag=args.bag,
        output=args.output or _default_output(args.bag, args.at is not None),
        camera=_camera(args),
        size=PictureSize.parse(args.size),
        rate=_RATE if args.fps is None else args.fps,
        speed=_SPEED if args.speed is None else args.speed,
        start=args.start or 0.0,
        end=args.end,
        at=args.at,
        quality=args.quality,
        overlay=args.overlay,
        gpu=args.gpu,
    )
    make_film(request)
    return 0


def _picture_time(text: str) -> float:
    """Return the time of a picture [s]; `math.inf` for the end.

    Raises:
        argparse.ArgumentTypeError: the text is neither a number nor `end`.
    """
    if text == "end":
        return math.inf
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a time [s] nor `end`") from None


def _default_output(bag: Path, is_picture: bool) -> Path:
    from msg_bridge.bag.bag_files import bag_name

    return _FOLDER / f"{bag_name(bag)}.{'png' if is_picture else 'mp4'}"


def _camera(args: argparse.Namespace) -> MachineCamera:
    """Return the camera of the options.

    Raises:
        EarthmovingError: `--orbit` is not readable, or belongs to another view.
    """
    from viewer.rendering.camera import MachineCamera

    machine = args.machine if not args.machine or args.machine[0] == "/" else f"/{args.machine}"
    if args.orbit is None:
        return MachineCamera(args.camera, machine, fov=args.fov)
    if args.camera != "orbit":
        raise EarthmovingError(f"--orbit belongs to --camera orbit, not to {args.camera}")
    try:
        values = [float(word) if word.strip() else None for word in args.orbit.split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 2, 3):
        raise EarthmovingError(
            f"--orbit {args.orbit}: give azimuth, elevation and distance, such as --orbit=-40,25,14"
        )
    azimuth, elevation, distance = [*values, None, None][:3]
    return MachineCamera("orbit", machine, azimuth, elevation, distance, args.fov)
