"""The key of a compiled kernel changes with the code it uses, and not with prose."""

import itertools
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from msg_bridge.kernels.cache import KernelFiles
from msg_bridge.kernels.code_digests import CodeDigests

_PACKAGE_NUMBERS = itertools.count()

KERNEL = '''\
"""A kernel that uses a function and a constant of other modules."""
from {package}.callee import square

def kernel(x):
    """Return the square of x, plus 1."""
    return square(x) + 1
'''
CALLEE = """\
from {package}.constants import FACTOR

def square(x):
    # the callee of the kernel
    return FACTOR * x * x
"""
CONSTANTS = """\
FACTOR = 1.0
"""


class TemporaryPackage:
    """A package of three modules, kernel -> callee -> constants, that can be edited."""

    def __init__(self, folder: Path) -> None:
        self.name = f"temporary_kernels_{next(_PACKAGE_NUMBERS)}"
        self._folder = folder / self.name
        self._folder.mkdir()
        self._seconds = 1_000_000_000
        self.write("__init__", "")
        self.write("kernel", KERNEL)
        self.write("callee", CALLEE)
        self.write("constants", CONSTANTS)
        self.write("unused", "VALUE = 1\n")

    def write(self, module: str, source: str) -> None:
        path = self._folder / f"{module}.py"
        path.write_text(source.format(package=self.name))
        # Python takes a .pyc file as current if the time of the source in whole seconds is the
        # same.
        self._seconds += 10
        os.utime(path, (self._seconds, self._seconds))

    def key(self) -> bytes:
        """Return the key of the kernel in a process that starts now."""
        return CodeDigests({self.name}).digest(f"{self.name}.kernel")


@pytest.fixture
def package(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    return TemporaryPackage(tmp_path)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("constants", CONSTANTS.replace("1.0", "2.0")),
        ("callee", CALLEE.replace("x * x", "x + x")),
        ("kernel", KERNEL.replace("+ 1\n", "+ 2\n")),
    ],
    ids=["constant", "callee", "kernel"],
)
def test_key_changes_with_the_code_a_kernel_uses(package, module, source):
    before = package.key()
    package.write(module, source)
    assert package.key() != before


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("kernel", KERNEL.replace("Return the square of x, plus 1.", "Return x**2 + 1.")),
        ("kernel", KERNEL.replace("of other modules", "of two modules\n\nand a second paragraph")),
        ("callee", CALLEE.replace("# the callee", "# a function\n    # that is the callee")),
        ("unused", "VALUE = 2\n"),
    ],
    ids=["docstring", "module docstring", "comment", "module that is not imported"],
)
def test_key_does_not_change_with_prose_and_unrelated_code(package, module, source):
    before = package.key()
    package.write(module, source)
    assert package.key() == before


def test_keys_of_kernels_that_use_other_modules_differ(package):
    digests = CodeDigests({package.name})
    assert digests.digest(f"{package.name}.callee") != digests.digest(f"{package.name}.constants")


POINT = """\
from typing import NamedTuple
from msg_bridge.kernels import kernel

class Point(NamedTuple):
    x: float

@kernel
def double(point):
    return 2.0 * point.x

print(double(Point(1.5)))
"""


def run_script(folder: Path, source: str, *, as_module: bool = True) -> str:
    """Run a script in a process with a kernel cache in the folder; return its output."""
    (folder / "script.py").write_text(source)
    root = Path(__file__).parents[3]
    arguments = ["-c", "import script"] if as_module else [str(folder / "script.py")]
    done = subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, "PYTHONPATH": f"{folder}:{root}", "NUMBA_CACHE_DIR": str(folder)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_cache_entry_with_a_type_that_was_renamed_is_compiled_again(tmp_path):
    for source in (POINT, POINT.replace("Point", "Position")):
        assert run_script(tmp_path, source) == "3.0\n"


SCRIPT = """\
from factors import get_factor
from msg_bridge.kernels import kernel

@kernel
def multiply(x):
    return get_factor() * x

print(multiply(1.5))
"""
FACTORS = """\
from msg_bridge.kernels import kernel
from constants import FACTOR

@kernel
def get_factor():
    return FACTOR
"""


@pytest.mark.parametrize("as_module", [True, False], ids=["module", "script"])
def test_kernel_outside_the_packages_runs_the_present_code_of_what_it_imports(tmp_path, as_module):
    (tmp_path / "factors.py").write_text(FACTORS)
    for factor, result in ((2.0, "3.0\n"), (10.0, "15.0\n")):
        (tmp_path / "constants.py").write_text(f"FACTOR = {factor}")
        assert run_script(tmp_path, SCRIPT, as_module=as_module) == result


SPAN = """\
from typing import NamedTuple
from span_kernel import length

class Span(NamedTuple):
    low: float
    high: float

print(length((Span(low=1.0, high=4.0),)))
"""


def test_change_of_the_order_of_fields_outside_of_the_kernels_imports_is_detected(tmp_path):
    (tmp_path / "span_kernel.py").write_text(
        "from msg_bridge.kernels import kernel\n"
        "@kernel\n"
        "def length(spans):\n"
        "    return spans[0].high - spans[0].low\n"
    )
    swapped = SPAN.replace("    low: float\n    high: float\n", "    high: float\n    low: float\n")
    for source in (SPAN, swapped):
        assert run_script(tmp_path, source) == "3.0\n"


def kernel_files(folder: Path, stamp: str = "code") -> KernelFiles:
    return KernelFiles(str(folder), "module.kernel", stamp)


def test_processes_that_save_signatures_at_the_same_time_do_not_mix_their_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = kernel_files(tmp_path), kernel_files(tmp_path)
    monkeypatch.setattr(second, "_load_index", dict)  # as before the first has saved
    other = threading.Thread(target=second.save, args=("float", "code for float"))
    save_data = first._save_data

    def save_data_after_the_other(name: str, data: str) -> None:
        other.start()
        other.join(0.5)  # it has saved, or waits for the first
        save_data(name, data)

    monkeypatch.setattr(first, "_save_data", save_data_after_the_other)
    first.save("int", "code for int")
    other.join()
    reader = kernel_files(tmp_path)
    assert reader.load("float") == "code for float"
    assert reader.load("int") in (None, "code for int"), "not the code of another signature"


def test_code_that_is_out_of_date_is_neither_loaded_nor_kept(tmp_path: Path) -> None:
    for stamp in ("old code", "new code"):
        files = kernel_files(tmp_path, stamp)
        assert files.load("int") is None
        files.save("int", stamp)
        files.save("float", stamp)
        assert [files.load(each) for each in ("int", "float")] == [stamp, stamp]
    assert len(list(tmp_path.glob("*.nbc"))) == 2


DOUBLE = """\
from msg_bridge.kernels import kernel

@kernel
def double(x):
    return 2.0 * x
"""
COUNT_BITCODE = """\
import gc
from double_kernel import double
from llvmlite.binding import ModuleRef

double(1.0)
modules = [each for each in gc.get_objects() if isinstance(each, ModuleRef) and not each.closed]
functions = [each for module in modules for each in module.functions if not each.is_declaration]
print(sum("double" in each.name for each in functions))
"""
QUADRUPLE = """\
from double_kernel import double
from msg_bridge.kernels import kernel

@kernel
def quadruple(x):
    return 2.0 * double(x)

double(1.0)
print(len(double.stats.cache_hits), quadruple(1.5))
"""


def test_bitcode_of_a_loaded_kernel_takes_memory_only_if_another_is_linked_with_it(tmp_path):
    (tmp_path / "double_kernel.py").write_text(DOUBLE)
    assert int(run_script(tmp_path, COUNT_BITCODE)) > 0  # it is compiled
    assert int(run_script(tmp_path, COUNT_BITCODE)) == 0
    assert run_script(tmp_path, QUADRUPLE) == "1 6.0\n"
