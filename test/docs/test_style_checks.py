"""The checks of words, sizes and docstrings find nothing in the tracked files, and find errors."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


terms, sizes, docstrings = (load(f"check_{each}") for each in ("terms", "sizes", "docstrings"))


def test_names_and_prose_use_the_terms_of_the_glossary() -> None:
    found = [
        f"{path}:{line}: {word!r}, better: {instead}" for path, line, word, instead in terms.hits()
    ]
    assert found == []


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("the node hears its machine", ["hears"]),
        ("inbox = Inbox(tell)", ["tell", "Inbox"]),
        ("the exchange receives a row; stream.tell()", []),
    ],
)
def test_replaced_words_are_found(line: str, words: list[str]) -> None:
    assert sorted(word for word, _ in terms.hits_in(line)) == sorted(words)


def test_functions_and_modules_are_within_the_limits() -> None:
    assert list(sizes.violations()) == []


LONG = "def f():\n" + "    pass\n" * sizes.MAX_FUNCTION_LINES
ARGUMENTS = ", ".join(f"a{k}" for k in range(sizes.MAX_ARGUMENTS + 1))
WIDE = f"def f({ARGUMENTS}): ..."
METHOD = f"class A:\n    def f(self, {ARGUMENTS}): ..."


@pytest.mark.parametrize(
    ("source", "count"),
    [
        (LONG, 1),
        (f"# One loop: splitting it is slower.\n{LONG}", 0),
        (LONG.replace(":\n", ':\n    """Run.\n\n    Notes:\n        One loop.\n    """\n', 1), 0),
        (WIDE, 1),
        (METHOD, 1),
        (f"# Numba needs plain arrays here.\n@njit\n{WIDE}", 0),
        (WIDE.replace("a0, ", ""), 0),
        ("\n" * (sizes.MAX_MODULE_LINES + 1), 1),
    ],
)
def test_sizes_beyond_the_limits_are_found_unless_a_reason_is_given(
    source: str, count: int
) -> None:
    assert len(list(sizes.violations_in("soil_sim/example.py", source))) == count


def test_test_modules_may_be_longer() -> None:
    source = "\n" * (sizes.MAX_MODULE_LINES + 1)
    assert list(sizes.violations_in("test/test_example.py", source)) == []


def test_docstrings_name_the_parameters_and_attributes_of_the_code() -> None:
    assert list(docstrings.violations()) == []


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def f({args}):\n    {doc}", "f: b is not documented"),
        ("class A:\n    {doc}\n    def __init__(self, {args}): ...", "A: b is not documented"),
        ("class A:\n    def f(self, {args}):\n        {doc}", "f: b is not documented"),
    ],
)
def test_args_that_differ_from_the_parameters_are_found(source: str, message: str) -> None:
    doc = '"""Sum up.\n\n    Args:\n        a, c: numbers.\n    """'
    fitting = source.format(args="a, c", doc=doc)
    assert list(docstrings.violations_in("example.py", fitting)) == []
    missing = source.format(args="a, b, c", doc=doc)
    assert [
        found.partition(" ")[2] for found in docstrings.violations_in("example.py", missing)
    ] == [message]
    unknown = source.format(args="a", doc=doc)
    assert len(list(docstrings.violations_in("example.py", unknown))) == 1


def test_attributes_that_the_class_does_not_have_are_found() -> None:
    source = '''class A(NamedTuple):
    """A pair.

    Attributes:
        a: first [m].
        b: second [m].
        total: sum [m].
    """

    a: float

    @property
    def total(self): ...
'''
    (found,) = docstrings.violations_in("example.py", source)
    assert found.endswith("A: b is not an attribute")
