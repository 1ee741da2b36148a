r"""Replace this process by a program, which ends when its parent dies.

    python -m msg_bridge.processes.child_main PARENT_PID msg_bridge.processes.exec_program \
        PROGRAM [ARGUMENT ...]

`child_main` has requested the signal of the parent's death, which the program inherits.
"""

from __future__ import annotations

import os
import sys

if __name__ == "__main__":
    os.execv(sys.argv[1], sys.argv[1:])
