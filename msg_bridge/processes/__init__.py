"""Child processes that end with their parent, and programs whose output is no longer read.

- `child_process`: ChildProcess: start, watch and stop a program whose output goes to a file
- `child_main`: runs a Python module in a process that the kernel ends with its parent
- `exec_program`: a program of another language instead of the module
- `broken_pipe`: ends a program quietly when its output is no longer read
"""

from msg_bridge.processes.child_process import ChildProcess, python_module_command

__all__ = ["ChildProcess", "python_module_command"]
