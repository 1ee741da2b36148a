"""Reads the reference machines of a machine file."""

from __future__ import annotations

from machine_sim.machine.reference_machine import FIGURE_UNITS, ReferenceMachine
from machine_sim.machine.spec_file.section import Section

__all__ = ["read_references"]


def read_references(sections: list[Section]) -> tuple[ReferenceMachine, ...]:
    """Read `references`: published figures of real machines."""
    return tuple(_read_reference(section) for section in sections)


def _read_reference(section: Section) -> ReferenceMachine:
    reference = ReferenceMachine(
        section.text("name"),
        section.text("source"),
        {
            figure: section.number(figure, positive=True)
            for figure in FIGURE_UNITS
            if section.has(figure)
        },
    )
    section.reject_unknown_keys()
    return reference
