"""List words that the glossary replaces, in names, comments and documents; exit code 1 if any.

    python docs/check_terms.py

`docs/glossary.md` has the terms to use. A word that is right in some context is allowed there by
the pattern itself, not by a list of exceptions.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

_SUFFIXES = (".py", ".md", ".yaml", ".toml", ".cfg", ".xml")

_EXCLUDED = (
    "docs/check_terms.py",
    "CHANGELOG.md",  # has the former names
    "msg_bridge/bag/legacy_names.py",  # maps the former names
    "test/msg_bridge/bag/test_legacy_names.py",
    "LICENSE",
)

NAMES = {
    # Former names, and the terms that replace them; whole identifiers.
    "SlipRule": "RelaxationParameters",
    "slip_radius": "relaxation_radius",
    "slip_tolerance": "relaxation_tolerance",
    "slip_budget": "relaxation_budget",
    "sound_sweeps": "validate_sweeps",
    "MOIST": "MOISTURE_LEVELS",
    "bearing_cohesion": "bekker_k_c",
    "bearing_friction": "bekker_k_phi",
    "bearing_exponent": "bekker_n",
    "shear_modulus": "janosi_k",
    "strays?": "fast outliers",
    "riders?": "locked load",
    "dormant": "spring history",
    "quiet_time": "settle_timer",
    "calm_time": "sleep_timer",
    "seams?": "colour boundary",
    "CommandBoard": "CommandArbiter",
    "MachineDescription": "MachineSpec",
    "load_description": "load_machine_spec",
    "load_acts": "payload_coupling",
    "cutting_acts": "cutting_forces",
    "await_listeners": "required_subscribers",
    "latched_period": "repeat_transient_local_period",
    "map_period": "map_rate",
    "hash_period": "hash_rate",
    "soil_owed": "conversion_backlog",
    "OWED": "BACKLOG",
    "LANDED": "DEPOSIT_REQUEST",
    "EarlyRows": "ReorderBuffer",
    "LeanNode": "SimNode",
    "Unwaited": "PolledGroup",
    "Inbox": "SubscriptionPoller",
    "MachineSide": "MachineEndpoint",
    "SoilSide": "SoilEndpoint",
    "Shift": "DigTask",
    "appetite": "target_fill",
    "brimming": "overfill_threshold",
    "most_lean": "max_pitch",
    "base_patience": "base_filter_time",
    "(?:conversions|landed|deposit_requests)_durable": "(removed)",
    "RunTold": "RunRecord",
}

PROSE = {
    # Objects are not persons, and sentences are plain; in comments, docstrings, texts and
    # documents.
    r"\banew\b": "again, or rebuild/recompute",
    r"\blikewise\b": "(say it)",
    r"\bof those (?:that|who)\b": "of the particles/cells that",
    r"\bwho (?:rests?|moves?|wakes?|sleeps?|touch(?:es)?|is|are)\b": "the particles that",
    r"\b(?:goes|gone) its way\b": "moved",
    r"\brides? along\b": "moves with",
    r"\bis told\b|\bare told\b|\btells\b": "is published/given; states",
    r"\bhears?\b|\bheard\b": "receives, received",
    r"\bfeels?\b": "is subject to",
    r"\bhow many are\b": "number of",
    r"\bin one another\b": "overlap",
    r"\bsquare to\b": "perpendicular to",
    r"\bsees to\b|\bis seen to\b": "handles",
    r"\bstrays?\b": "fast outliers",
    r"\briders?\b": "locked load",
    r"\blively\b": "active",
    r"\bsource numbers?\b": "machine ids",
    r"\blets? the machine down\b": "lowers the machine",
    r"\bin-process way\b|\bas nodes\b": "in one process; with ROS nodes",
}


def main() -> int:
    """Print every hit; 1 if there are any."""
    found = list(hits())
    for path, line, word, instead in found:
        print(f"{path}:{line}: {word!r}" + (f" -> {instead}" if instead else ""))
    print(f"{len(found)} words to replace")
    return 1 if found else 0


def hits() -> Iterator[tuple[str, int, str, str]]:
    """Yield file, line number, word and replacement of every hit in tracked files."""
    tracked = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()
    names = {rf"\b{name}\b": instead for name, instead in NAMES.items() if instead}
    patterns = [(re.compile(pattern), instead) for pattern, instead in names.items()]
    patterns += [(re.compile(pattern, re.I), instead) for pattern, instead in PROSE.items()]
    for name in tracked:
        if not name.endswith(_SUFFIXES) or name in _EXCLUDED or not (ROOT / name).is_file():
            continue
        text = (ROOT / name).read_text(encoding="utf-8")
        for number, line in enumerate(text.splitlines(), start=1):
            for pattern, instead in patterns:
                for match in pattern.finditer(line):
                    yield name, number, match.group(0), instead


if __name__ == "__main__":
    sys.exit(main())
