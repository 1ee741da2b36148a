"""Crash recovery: a run that a process which was killed continues after its restart.

A node writes the inputs of each tick before it sends anything that depends on them, and all of its
state every few seconds. A restarted process loads the newest state, and computes the ticks after it
again from their inputs.

- `params`: parameters of a node
- `run_store`: inputs of a run, in SQLite
- `checkpoints`: states of a run, in SQLite, written by another thread
- `packed_messages`: messages in a form that is written fast
- `run_journal`: what a node calls
- `config_comparison`: whether a restarted node has the parameters of its run
- `node_recovery`: the journal of a node with its log and diagnostics
"""
