"""Publish the messages of a recording on their topics, for hosts without `ros2 bag`.

Each topic is published byte by byte with the QoS of the recorded publishers. At the begin, after a
seek and at each loop the state before the position is published first: the newest message of each
transient-local topic, and the map updates since the terrain map. In a terminal, space pauses, the
arrows seek and change the rate, s publishes the next message and q ends.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from pathlib import Path

from msg_bridge.count_text import count_text

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "publish a recording on ROS topics"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the bag and how it is played."""
    parser.add_argument("bag", type=Path, help="folder of a bag, or an .mcap file")
    parser.add_argument(
        "-r", "--rate", type=float, default=1.0, help="seconds of the recording per second (1)"
    )
    parser.add_argument(
        "--start", type=float, default=0.0, metavar="S", help="begin at this time [s] (0)"
    )
    parser.add_argument(
        "--end", type=float, default=0.0, metavar="S", help="end at this time [s] (end of the bag)"
    )
    parser.add_argument("-l", "--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--paused", action="store_true", help="begin paused")
    parser.add_argument(
        "--include", default="", metavar="REGEX", help="play only topics whose names match"
    )
    parser.add_argument(
        "--exclude", default="", metavar="REGEX", help="do not play topics whose names match"
    )
    parser.add_argument(
        "--prefix",
        default="",
        metavar="NAMESPACE",
        help="put a namespace before all topics, to play beside a running simulation",
    )
    parser.add_argument(
        "--clock",
        choices=("auto", "log", "none"),
        default="auto",
        help="source of /clock: the recorded messages or else log times (auto), log times, or none",
    )


def run(args: argparse.Namespace) -> int:
    """Play the bag to its end, `q` or Ctrl-C; return 0.

    Raises:
        EarthmovingError: it cannot be read or played.
    """
    from msg_bridge.nodes.process_main import run_node
    from msg_bridge.player.keys import HELP, KeyReader
    from msg_bridge.player.params import PlayerParams
    from msg_bridge.player.player_node import PlayerNode
    from msg_bridge.raw_topics.topic_selection import validate_expression

    for name in ("include", "exclude"):
        validate_expression(f"--{name}", getattr(args, name))
    values = {field.name: getattr(args, field.name) for field in fields(PlayerParams)}
    params = PlayerParams.from_mapping(values, prefix="--")
    with KeyReader() as keys:

        def make_node() -> PlayerNode:
            node = PlayerNode(args.bag, params, keys)
            print(
                f"{args.bag}: {count_text(node.num_messages, 'message')} on"
                f" {count_text(node.num_topics, 'topic')},"
                f" {node.playback.duration:.1f} s",
                flush=True,
            )
            for topic, kind in node.skipped.items():
                print(f"  {topic} is not played: {kind} is not installed", file=sys.stderr)
            if keys.is_terminal:
                print(f"  {HELP}", flush=True)
            return node

        code = run_node(make_node, ["bag_player"], name="earthmoving play")
        if keys.is_terminal:
            print()
    return code
