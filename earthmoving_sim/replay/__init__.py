"""Replay: run a recorded simulation again, in one process, from its bag alone.

The inputs of a run are the configurations of its nodes, the files that they have read
(attachments), the commands that took effect in each tick (`<m>/applied_commands`), and the order in
which soil and machines processed ticks, joins and departures (headers). The replay gives these
inputs to the same soil, machine and exchange objects as the nodes have, and compares what comes out
with what was recorded.

Modules:

- `recorded`: what a bag has of the runs
- `node_parameters`: parameters of the nodes from their configurations, and changes of them
- `run_setups`: parameters of all nodes of a run, as recorded or with changes
- `replayed_soil`, `replayed_machines`: soil and machine nodes that do it again
- `run_replay`: all of a run; its `replay_result`
- `placement_terrain`: terrain on which machines are placed
- `saved_state`: its state after a tick, from which it continues
- `comparison`, `difference_details`: the first difference from the recording
- `observer`: what follows a replay; `replay_recording` records it through a `bag_node`
"""
