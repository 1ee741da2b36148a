"""Record the state hashes of a set of scenes, and compare them after a refactoring.

    python -m benchmarks.state_hashes record hashes.json     # before the change
    python -m benchmarks.state_hashes compare hashes.json    # after it; exit code 1 if any differ

Each scene of `state_hash_scenes` runs soil and machines in one process and takes the state hashes
of both at regular ticks. A refactoring must leave all of them unchanged. Hashes are only equal on
one family of processors and with one set of package versions, so record them on the same computer.
`--scene NAME` (repeatable) selects scenes; `list` prints their names.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from benchmarks.state_hash_scenes import Hashes, make_scenes


def main() -> int:
    """Record, compare or list; return 1 if hashes differ."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("action", choices=("record", "compare", "list"), help="what to do")
    parser.add_argument("file", type=Path, nargs="?", help="JSON file of hashes by scene")
    parser.add_argument("--scene", action="append", help="only this scene; repeatable")
    options = parser.parse_args()
    scenes = make_scenes()
    if options.action == "list":
        print("\n".join(scenes))
        return 0
    if options.file is None:
        parser.error("name the file of hashes")
    recorded: dict[str, Hashes] = {}
    if options.file.exists():
        recorded = json.loads(options.file.read_text(encoding="utf-8"))
    num_failed = 0
    for name in options.scene or scenes:
        start = time.perf_counter()
        hashes = scenes[name]()
        seconds = time.perf_counter() - start
        if options.action == "record":
            recorded[name] = hashes
            options.file.write_text(json.dumps(recorded, indent=1), encoding="utf-8")
            verdict = "recorded"
        else:
            verdict = compare_hashes(recorded.get(name), hashes)
            num_failed += verdict != "same"
        print(f"{name:<32} {len(hashes):4d} hashes  {seconds:6.1f} s  {verdict}", flush=True)
    return 1 if num_failed else 0


def compare_hashes(before: Hashes | None, after: Hashes) -> str:
    """Return "same", or a text that states where two runs first differ."""
    if before is None:
        return "not recorded before"
    pairs = enumerate(zip(before, after, strict=False))
    first = next((k for k, (old, new) in pairs if old != new), None)
    if first is not None:
        return f"DIFFERS from hash {first + 1} of {len(before)} on"
    return "same" if len(before) == len(after) else f"DIFFERS in length: {len(before)} before"


if __name__ == "__main__":
    sys.exit(main())
