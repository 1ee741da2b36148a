"""Machines at work: what they and the soil do to each other.

- `sweep`: where tools and tracks went; `release`: what was cut becomes particles
- `payload`: what a tool holds
- `resistance`, `milling`: what tools feel of the soil they cut, press and mill
- `bin`: what stands there and holds soil
- `tool_work`: one tool with all of that; `rig`: one machine with its tools
"""
