"""Machine files: YAML, every key checked, into a `MachineSpec`.

- `section`: strict reading of one mapping
- `machine`: links, joints, tracks, sensors; `cylinders`, `tools`: what it says of those
"""
