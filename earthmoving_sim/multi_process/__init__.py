"""A run with soil, machine, operator and recorder as ROS 2 nodes, as a launch file starts them.

- `parameter_file`: the parameters of a run as one ROS parameter file
- `node_process`: a node in a process of its own
- `run_monitor`: progress of the nodes, from `/diagnostics`
- `dig`: start the nodes, wait until the operator has finished, stop them in order
"""
