"""Run a recorded simulation again from its bag, and compare every tick with the recording.

The bag contains all that the run depended on: parameters, seeds, files, the commands in force in
each tick, joins and departures. Soil and machines are computed again in one process and compared
with the recording: all headers with the digests of their rows, the ledger, and the state hashes.
Exits with 0 if all ticks are identical, else with 1. With `--what-if` the same commands are given
to other soil or another machine, and the outcomes of both runs are compared.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import asdict
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from earthmoving_sim.option_checks import check_output_file

if TYPE_CHECKING:
    from earthmoving_sim.replay.run_replay import RunReplay

__all__ = ["SUMMARY", "add_arguments", "run"]

SUMMARY = "run a recorded simulation again from its bag, and compare every tick"

_PROGRESS_PERIOD = 0.5
"""Wall time between two lines of progress [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `earthmoving replay`."""
    parser.add_argument("bag", type=Path, help="folder of a bag, or an .mcap file")
    parser.add_argument(
        "--what-if",
        action="append",
        default=[],
        metavar="[NODE:]NAME:=VALUE",
        help='give a parameter another value, as soil.soil:="wet clay" or'
        " /excavator:machine:=my.yaml; the same commands then act under other conditions, from the"
        " begin or from the state of --from on; nothing is compared tick by tick, and volumes and"
        " cycles of both runs are printed",
    )
    parser.add_argument("--until", type=int, metavar="TICK", help="last tick to replay")
    parser.add_argument(
        "--save", type=Path, metavar="STATE", help="write the state after the last tick to a file"
    )
    parser.add_argument(
        "--from",
        type=Path,
        metavar="STATE",
        dest="state",
        help="continue from a state that was saved, in place of the begin of the run; use only"
        " files of your own: they can contain programs",
    )
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FOLDER",
        help="record the replay into a bag (with --what-if: bags/what-if-<time> by default)",
    )
    parser.add_argument(
        "--run",
        type=int,
        metavar="ID",
        dest="run_id",
        help="replay only this run of a bag with several",
    )
    parser.add_argument(
        "--namespace", help="namespace of the simulation; needed if the bag has several"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Replay the runs of the bag and print the result; return 0 if all are identical, else 1."""
    from earthmoving_sim.reading_progress import reading_progress
    from earthmoving_sim.replay.node_parameters import parse_change
    from earthmoving_sim.replay.recorded.run_survey import survey_runs
    from earthmoving_sim.replay.replay_recording import ReplayRecording
    from earthmoving_sim.replay.run_replay import RunReplay
    from earthmoving_sim.run_figures.figures import compare_figures, read_figures
    from msg_bridge.bag.reader import BagReader
    from msg_bridge.contract.errors import EarthmovingError

    if args.until is not None and args.until < 1:
        raise EarthmovingError(f"--until is {args.until}; give a tick from 1 on")
    if args.save is not None:
        check_output_file("--save", args.save)
    changes = [parse_change(text) for text in args.what_if]
    reader = BagReader(args.bag, namespace=args.namespace)
    reader.check_simulation()
    known = surveys = survey_runs(reader, reading_progress())
    if args.run_id is not None:
        surveys = [each for each in surveys if each.run_id == args.run_id]
    folder = args.record or (_default_folder() if changes else None)
    is_of_one_run = not (folder is args.save is args.state is None)
    if not surveys or (is_of_one_run and len(surveys) > 1):
        ids = ", ".join(str(each.run_id) for each in known)
        raise EarthmovingError(
            f"{args.bag} has the runs {ids}; choose one by --run"
            if known
            else f"{args.bag} has no configuration on /sim/config; record it from the begin"
        )
    reports = []
    for survey in surveys:
        replay = RunReplay(reader, survey, changes)
        with ExitStack() as stack:
            stack.callback(replay.close)
            if args.state is not None:
                replay.restore(args.state)
                if args.until is not None and args.until <= replay.result.first_tick:
                    raise EarthmovingError(
                        f"{args.state} is of tick {replay.result.first_tick}; give a later --until"
                    )
            if folder is not None:
                recording = ReplayRecording(folder, reader.namespace)
                stack.callback(recording.close)
                replay.follow(recording)
            if not args.json:
                print(f"{args.bag}: run {survey.run_id}, {_describe(replay)}", flush=True)
            progress = _Progress(replay) if sys.stderr.isatty() else None
            replay.run(progress, until=args.until)
            if not args.json:
                print("\n".join(_lines(replay, reader.truncated, is_what_if=bool(changes))))
            if args.save is not None:
                replay.save(args.save)
        reports.append(_report(replay, is_what_if=bool(changes)))
        if not args.json:
            if folder is not None:
                print(f"  recorded into {folder}")
            if args.save is not None:
                print(f"  state after tick {replay.result.last_tick} written to {args.save}")
    figures = []
    if changes and folder is not None:
        replayed = BagReader(folder, namespace=None)
        ticks = replay.result.first_tick, replay.result.last_tick
        begin, end = ((tick + 0.5) * replay.facts.tick_period for tick in ticks)
        figures = [read_figures(each, survey.run_id, begin, end) for each in (reader, replayed)]
        if not args.json:
            print("\n".join(compare_figures(figures[0], figures[1], "what if")))
    if args.json:
        result = {
            "path": str(args.bag),
            "truncated": list(reader.truncated),
            "what_if": list(map(str, changes)),
            "recorded_into": None if folder is None else str(folder),
            "runs": reports,
            "figures": [asdict(each) for each in figures],
        }
        print(json.dumps(result, indent=2))
    if changes:
        return 1 if any(each["ended_early"] for each in reports) else 0
    return 0 if all(each["identical"] for each in reports) else 1


def _default_folder() -> Path:
    return Path("bags") / f"what-if-{datetime.now(timezone.utc):%Y-%m-%dT%H-%M-%SZ}"


class _Progress:
    """Prints a line of progress now and then."""

    def __init__(self, replay: RunReplay) -> None:
        self._period, self._first_tick = replay.facts.tick_period, replay.result.first_tick
        self._start = self._last = time.monotonic()

    def __call__(self, tick: int) -> None:
        """Print the progress after a tick if it is due."""
        now = time.monotonic()
        if now - self._last < _PROGRESS_PERIOD:
            return
        self._last = now
        simulated = (tick - self._first_tick) * self._period
        factor = simulated / (now - self._start)
        print(
            f"  tick {tick}, {simulated:.1f} s, {factor:.1f} x real time ",
            end="\r",
            file=sys.stderr,
            flush=True,
        )


def _describe(replay: RunReplay) -> str:
    """Return what is replayed."""
    facts, grid = replay.facts, replay.soil.soil.grid
    sync = "real time" if facts.realtime else "lockstep"
    nodes = ", ".join(sorted(replay.survey.nodes.values())) or "no machines"
    return f"{sync}, terrain of {grid.rows} x {grid.cols} columns, {nodes}"


def _report(replay: RunReplay, *, is_what_if: bool) -> dict[str, Any]:
    """Return the result of a replay for JSON; of what was not compared, `identical` is null."""
    result = replay.result
    difference = result.difference
    return {
        "run_id": replay.survey.run_id,
        "identical": None if is_what_if else result.is_identical,
        "first_tick": result.first_tick,
        "last_tick": result.last_tick,
        "ledgers": result.num_ledgers,
        "missing_ledgers": result.num_missing_ledgers,
        "hashes": result.num_hashes,
        "difference": None
        if difference is None
        else {"tick": difference.tick, "where": difference.where, "text": difference.text},
        "ended_early": result.ended_early,
        "simulated_time": result.simulated_time,
        "wall_time": result.wall_time,
        "other_versions": replay.survey.other_versions,
    }


def _lines(replay: RunReplay, truncated: Iterable[str], *, is_what_if: bool) -> list[str]:
    """Return the lines of the printed result."""
    result = replay.result
    lines = [
        f"  recorded with {name} {recorded}, replayed with {here}"
        for name, (recorded, here) in replay.survey.other_versions.items()
    ]
    begin = f" from tick {result.first_tick:,} on" if result.first_tick else ""
    if result.difference is not None:
        lines.append(f"  ✗ first difference: {result.difference}")
    elif result.ended_early:
        compared = "" if is_what_if else " without a difference"
        lines.append(f"  ✗ replayed up to tick {result.last_tick}{compared}: {result.ended_early}")
    elif is_what_if:
        lines.append(f"  the same commands over {result.num_ticks:,} ticks, not compared")
    elif result.num_missing_ledgers:
        lines.append(
            f"  ✗ no difference over {result.num_ticks:,} ticks{begin}, but the ledgers of"
            f" {result.num_missing_ledgers:,} ticks are missing or cannot be read"
        )
    else:
        hashes = ", ".join(f"{count} of {name}" for name, count in result.num_hashes.items())
        lines += [
            f"  ✓ identical over {result.num_ticks:,} ticks{begin}: all headers with their"
            f" digests of rows, {result.num_ledgers:,} ledgers",
            f"    state hashes: {hashes or 'none recorded'}",
        ]
    lines += [f"  {name} has no end; what came after its last chunk is lost" for name in truncated]
    factor = result.simulated_time / max(result.wall_time, 1e-9)
    lines.append(
        f"  {result.simulated_time:.1f} s replayed in {result.wall_time:.1f} s:"
        f" {factor:.1f} x real time"
    )
    return lines
