"""Derive from a bag alone what a run of the operator did.

Modules in the order of the computation:

- `topic_decoders`: which topics are read, and what is kept of each message
- `run_record`: the last run in a bag, sorted by tick, and its last tick
- `recorded_terrain`: the terrain before and after, from its first map and its updates
- `recorded_machine`: the machine's specification, the path of its lip, the poses of its shoes
- `outcome`: the `DigOutcome` of all this, as a run in one process returns it
"""

from earthmoving_sim.recorded_run.outcome import outcome_from_bag
from earthmoving_sim.recorded_run.topic_decoders import RecordedRunError

__all__ = ["RecordedRunError", "outcome_from_bag"]
