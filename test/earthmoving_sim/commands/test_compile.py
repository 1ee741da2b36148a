"""`earthmoving compile` fills the kernel cache."""

from __future__ import annotations

import pytest

from earthmoving_sim.cli import main


def test_compile_makes_all_groups_ready(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["compile"]) == 0
    lines = capfd.readouterr().out.splitlines()
    for group in ("soil_sim", "machine_sim"):
        assert any(each.startswith(f"{group}: all kernels are in the cache") for each in lines)
