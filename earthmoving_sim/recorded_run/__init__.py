"""What a run did, made out from its bag alone.

- `outcome`: the same `Outcome` that a run in one process gives
- `words`: the topics it takes, and what it keeps of each message
- `run`: the last run in a bag, and where it ends
- `terrain`: the ground before and after
- `machine`: where the machine and its lip were
"""
