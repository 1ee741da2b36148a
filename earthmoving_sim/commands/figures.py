"""Make pictures after figures 5 and 18 to 30 of the reference of 2014.

Each scene is simulated in this process and drawn by the live page in a browser without a window;
`make chromium` installs it. Writes the pictures, and index.html and index.md with captions and
measured values. All figures take some minutes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from earthmoving_sim.option_checks import create_output_folder
from msg_bridge.contract.errors import EarthmovingError

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "make pictures after the figures of the reference of 2014"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `earthmoving figures`."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out/figures"),
        metavar="DIR",
        help="folder for the pictures (default: %(default)s)",
    )
    parser.add_argument(
        "--only", metavar="N,N", help="only these figures, such as 18,22 (default: all)"
    )
    parser.add_argument(
        "--size", default="1280x720", metavar="WxH", help="size in pixels (default: %(default)s)"
    )
    parser.add_argument(
        "--quality",
        choices=("low", "medium", "high"),
        default="high",
        help="detail of the pictures (default: %(default)s)",
    )
    parser.add_argument("--gpu", action="store_true", help="draw with the GPU")


def run(args: argparse.Namespace) -> int:
    """Make the figures; return 0."""
    from earthmoving_sim.figures.catalogue import NUMBERS, groups_of
    from earthmoving_sim.figures.contact_sheet import write_contact_sheet
    from earthmoving_sim.figures.studio import Studio
    from viewer.rendering.browser import find_browser
    from viewer.rendering.picture import PictureSize

    groups = groups_of(_numbers(args.only) if args.only else NUMBERS)
    find_browser()
    create_output_folder("--output", args.output)
    studio = Studio(args.output, PictureSize.parse(args.size), quality=args.quality, gpu=args.gpu)
    figures = []
    for group in groups:
        names = " and ".join(map(str, group.numbers))
        print(f"Figure {names} ...", flush=True)
        figures += group.make(studio)
    page, text = write_contact_sheet(figures, args.output)
    print(f"{page}\n{text}")
    return 0


def _numbers(text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise EarthmovingError(f"--only {text}: give numbers of figures, such as 18,22") from None
