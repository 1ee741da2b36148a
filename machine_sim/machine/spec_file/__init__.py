"""Machine files: reads YAML into a `MachineSpec` and validates every key.

- `loader`: the whole file, and the checks between its sections
- `section`: strict reading of one mapping
- `links`: links and inertial measurement units
- `joints`: joints, initial angles, main body and joystick axes
- `cylinders`: hydraulic cylinders and their supply
- `tracks`: the pair of tracks
- `tools`: buckets, drums and beds
- `shapes`: visual shapes, materials and view points
"""

from machine_sim.machine.spec_file.loader import find_shapes_file, load_machine_spec

__all__ = ["find_shapes_file", "load_machine_spec"]
