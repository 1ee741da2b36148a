"""Interaction of tools and tracks with soil.

- `sweep`: SWEEP rows of tools and tracks in a tick
- `pending_soil`: excavated soil that becomes particles
- `payload`: soil in a tool
- `soil_level`: room of a bucket below the level of the soil ahead; `room`: as it is reported
- `bucket_fill`: payload and room of a bucket in one pass; `edge_soil`: soil that a tool takes in
- `resistance`, `milling_resistance`: forces of the soil on tools that cut, rest and mill;
  `capped_spring_damper`: how they act; `milling_kernels`: the picks of a drum
- `tools`: the kinds of tools, one module each
- `coupling`: one tool with all of these
"""
