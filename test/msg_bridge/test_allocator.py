"""Freed memory: large arrays do not need new pages of the system, and free pages are returned."""

import subprocess
import sys

import pytest

COUNT_PAGE_FAULTS = """
import resource, sys
import numpy as np
from msg_bridge.allocator import keep_freed_memory
if sys.argv[1] == "keep" and not keep_freed_memory():
    print(-1)
    sys.exit()
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
def use():
    blocks = [np.ones(3_000_000, dtype=np.uint8) for _ in range(3)]
use()
before = faults()
for _ in range(20):
    use()
print(faults() - before)
"""


def num_page_faults(mode: str) -> int:
    command = [sys.executable, "-c", COUNT_PAGE_FAULTS, mode]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def test_large_arrays_reuse_freed_memory() -> None:
    kept, by_default = num_page_faults("keep"), num_page_faults("default")
    if kept < 0 or by_default < 10_000:
        pytest.skip("the C library is not glibc, or the system has large pages")
    assert kept < 0.05 * by_default


RETURN_MEMORY = """
import sys
from pathlib import Path
from msg_bridge.allocator import keep_freed_memory, return_freed_memory
def resident_kb():
    return int(Path("/proc/self/status").read_text().partition("VmRSS:")[2].split()[0])
if not keep_freed_memory():
    print(-1)
    sys.exit()
blocks = [bytes(4000) for _ in range(20_000)]
del blocks[:-1]  # the last one is at the end of the heap
before = resident_kb()
return_freed_memory()
print(before - resident_kb())
"""


def test_free_pages_are_returned() -> None:
    command = [sys.executable, "-c", RETURN_MEMORY]
    returned = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    if returned < 0:
        pytest.skip("the C library is not glibc")
    assert returned > 60_000
