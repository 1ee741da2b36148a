"""List functions and modules that are too long, and functions with too many arguments; exit code 1.

    python docs/check_sizes.py

A function has at most 100 lines and 15 arguments, a module at most 400 lines, a test module 600. A
function may exceed its limits if a comment directly above it, or a section "Notes" of its
docstring, gives the reason.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

MAX_FUNCTION_LINES = 100
MAX_ARGUMENTS = 15
MAX_MODULE_LINES = 400
MAX_TEST_MODULE_LINES = 600


def main() -> int:
    """Print every violation; 1 if there are any."""
    found = list(violations())
    print(*found, f"{len(found)} functions or modules to split", sep="\n")
    return 1 if found else 0


def violations() -> Iterator[str]:
    """Yield a line for each violation in the tracked Python files."""
    tracked = subprocess.check_output(["git", "ls-files", "*.py"], cwd=ROOT, text=True)
    for name in tracked.splitlines():
        if (ROOT / name).is_file():
            yield from violations_in(name, (ROOT / name).read_text(encoding="utf-8"))


def violations_in(name: str, source: str) -> Iterator[str]:
    """Yield a line for each violation in a module."""
    lines = source.splitlines()
    max_lines = MAX_TEST_MODULE_LINES if name.startswith("test/") else MAX_MODULE_LINES
    if len(lines) > max_lines:
        yield f"{name}: {len(lines)} lines; at most {max_lines}"
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) or has_reason(node, lines):
            continue
        num_lines = (node.end_lineno or node.lineno) - node.lineno + 1
        if num_lines > MAX_FUNCTION_LINES:
            limit = MAX_FUNCTION_LINES
            yield f"{name}:{node.lineno}: {node.name} has {num_lines} lines; at most {limit}"
        if num_arguments(node) > MAX_ARGUMENTS:
            count, limit = num_arguments(node), MAX_ARGUMENTS
            yield f"{name}:{node.lineno}: {node.name} has {count} arguments; at most {limit}"


def num_arguments(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the number of named arguments, `self` and `cls` excepted."""
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return len([each for each in arguments if each.arg not in ("self", "cls")])


def has_reason(node: ast.FunctionDef | ast.AsyncFunctionDef, lines: list[str]) -> bool:
    """Return whether a comment above the function or the Notes of its docstring give a reason."""
    first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
    is_commented = first > 1 and lines[first - 2].lstrip().startswith("#")
    docstring = ast.get_docstring(node) or ""
    return is_commented or re.search(r"^Notes?:?$", docstring, re.MULTILINE) is not None


if __name__ == "__main__":
    sys.exit(main())
