"""Show a recording on the live page, with play, pause, seek and rate.

The page opens in the browser if there is a display; the address is printed in any case. No node
runs. `viewer` shows a running simulation on the same page, and also the bags of its `bag_folder`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "show a recording in the browser"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the bag and where it is served."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="a bag: a folder or an .mcap file")
    parser.add_argument(
        "--port", type=_port, default=8081, help="port of the page (default: 8081; 0: any free one)"
    )
    parser.add_argument("--no-browser", action="store_true", help="do not open the browser")


def run(args: argparse.Namespace) -> int:
    """Serve the bag until Ctrl-C; return 0.

    Raises:
        EarthmovingError: there is no such bag, it cannot be read, or the port is taken.
    """
    from viewer.bag_server import serve_bag

    serve_bag(args.bag, args.port, open_browser=not args.no_browser)
    return 0


def _port(text: str) -> int:
    """Return the number of a port."""
    port = int(text)
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"a port is 0 to 65535, not {port}")
    return port
