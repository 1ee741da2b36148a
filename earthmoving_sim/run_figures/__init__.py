"""Figures of recorded runs, by which runs are compared.

- `figures`: volumes, cut and fill, and cycles of a run, from its bag
- `payload_cycles`: cycles of a machine by its payload
"""
