"""A run with every part in a ROS 2 node of its own, as a launch file would start it.

- `run`: starts soil, machine, operator and recorder, tells how it goes, stops them in order
- `parameters`: a run's parameters as one ROS parameter file
- `processes`: nodes as processes, watched and stopped
"""
