"""Compilation of the kernels of machines before the first tick."""

from __future__ import annotations

from dataclasses import replace

from support.machine_scenes import excavator

from machine_sim.warm_up import warm_up


def test_machine_without_tools_is_warmed_up() -> None:
    warm_up([replace(excavator(), tools={})])
