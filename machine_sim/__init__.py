"""Machines, and soil as particles.

- `core`: one tick of it, release -> drive, carry, spill, fall -> settle; `params`: how it steps
- `machine`: an excavator from a data file, in pybullet
- `particles`: contact dynamics of soil among tools and terrain
- `ground`: the copy of the terrain that tracks and particles touch
- `sweep`: where the tool's key points went; `release`: what it cut becomes particles
- `payload`: what is in the tool
- `operator`: a script at the levers

No ROS and nothing of the soil side: they meet in `msg_bridge.contract`.
"""
