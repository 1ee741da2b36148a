"""`python -m earthmoving_sim` is the `earthmoving` command."""

import sys

from earthmoving_sim.cli import main

if __name__ == "__main__":
    sys.exit(main())
