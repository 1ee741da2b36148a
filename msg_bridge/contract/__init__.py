"""What soil and machines agree on; no ROS, no physics.

- `grid`: which column lies where
- `rows`: row types of everything that crosses
- `messages`: headers, chunks of rows, requests
- `ledger`: where every cubic millimetre is
- `cylinders`: how a hydraulic cylinder is doing
- `parameters`: parameter sets checked when built
- `constants`: gravity, the scale of moisture
- `errors`: the errors of the package
"""
