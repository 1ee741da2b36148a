"""Checks of the computer and its installation, for `earthmoving check`.

- `check_result`: CheckResult, Status
- `probe`: run a piece of code in another Python
- `dependencies`: Python and the packages that the simulation needs
- `ros`: ROS 2 and its messages
- `resources`: configuration files, output folder, cores, memory
"""
