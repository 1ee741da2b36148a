"""List names in docstrings that the code does not have; exit code 1 if any.

    python docs/check_docstrings.py

A section "Args:" lists all parameters of its function, or of its class's `__init__`, and no other
names. A section "Attributes:" of a class lists only its fields, attributes and properties. A line
of a section may list several names, such as `first, second: rows of the particles`.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

Function = ast.FunctionDef | ast.AsyncFunctionDef

_SECTION_NAMES = re.compile(r" {4}(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: \(.*?\))?:(?: |$)")


def main() -> int:
    """Print every violation; 1 if there are any."""
    found = list(violations())
    print(*found, f"{len(found)} names to correct", sep="\n")
    return 1 if found else 0


def violations() -> Iterator[str]:
    """Yield a line for each violation in the tracked Python files, tests excepted."""
    tracked = subprocess.check_output(["git", "ls-files", "*.py"], cwd=ROOT, text=True)
    for name in tracked.splitlines():
        if (ROOT / name).is_file() and not name.startswith("test/"):
            yield from violations_in(name, (ROOT / name).read_text(encoding="utf-8"))


def violations_in(name: str, source: str) -> Iterator[str]:
    """Yield a line for each violation in a module."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, Function):
            wrong = compare(documented_names(node, "Args"), parameter_names(node))
        elif isinstance(node, ast.ClassDef):
            init = next((each for each in node.body if is_named(each, "__init__")), None)
            wrong = compare(documented_names(node, "Args"), parameter_names(init) if init else [])
            attributes = attribute_names(node)
            wrong += [
                f"{each} is not an attribute"
                for each in documented_names(node, "Attributes")
                if each not in attributes
            ]
        else:
            continue
        for message in wrong:
            yield f"{name}:{node.lineno}: {node.name}: {message}"


def compare(documented: list[str], parameters: list[str]) -> list[str]:
    """Return a message for each name that is only documented or, if any is, only a parameter."""
    unknown = [f"{each} is not a parameter" for each in documented if each not in parameters]
    missing = [f"{each} is not documented" for each in parameters if each not in documented]
    return unknown + (missing if documented else [])


def documented_names(node: Function | ast.ClassDef, section: str) -> list[str]:
    """Return the names that a section of a docstring lists; none without the section."""
    docstring = ast.get_docstring(node) or ""
    match = re.search(rf"^{section}:\n((?:(?: .*)?\n)*)", f"{docstring}\n", re.MULTILINE)
    lines = match[1].splitlines() if match else []
    names = [found[1] for line in lines if (found := _SECTION_NAMES.match(line))]
    return [name.lstrip("*") for each in names for name in each.split(", ")]


def parameter_names(node: Function) -> list[str]:
    """Return the names of all parameters but `self`, `cls` and those with a leading underscore."""
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    arguments += [each for each in (node.args.vararg, node.args.kwarg) if each]
    return [
        each.arg
        for each in arguments
        if each.arg not in ("self", "cls") and not each.arg.startswith("_")
    ]


def attribute_names(node: ast.ClassDef) -> set[str]:
    """Return the names that a class defines, and those that its methods assign to `self`."""
    names = {each.name for each in node.body if isinstance(each, Function)}
    for each in ast.walk(node):
        if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Store):
            names.add(each.attr)
        elif isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store):
            names.add(each.id)
    return names


def is_named(node: ast.stmt, name: str) -> bool:
    """Return whether a statement defines the function `name`."""
    return isinstance(node, Function) and node.name == name


if __name__ == "__main__":
    sys.exit(main())
