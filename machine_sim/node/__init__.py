"""Machine node: one machine or several, and the soil they move, as a ROS 2 node.

Path of a command, from its topic to the machine::

    topic                 command_subscriptions   message -> receive_...(values, time)
      |                     CommandSubscriptions    rejected ones go to the diagnostics
      v
    command_scheduler     CommandScheduler        when it takes effect: now, or `command_delay`
      |                                             ticks after its stamp (lockstep)
      v
    commands.arbiter      CommandArbiter          validation, the newest command of each actuator,
      |                                             timeout, emergency stop
      v
    machine_run           MachineRun              at the start of a tick, once awaited commands
      |                                             are there: `apply_commands`
      v
    machine               TrackedMachine.command  joint velocities [rad/s], track speeds [m/s]

The new state is published at the end of the tick, `applied_commands` at its start.

Modules:

- `machine_node`: the node: parameters, wiring and the tick
- `params`, `usage`: its parameters, and the text of `--help`
- `machine_instance`: one machine of the node independent of a run
- `machine_run`: the machines in one run of the soil: when they step and what is due
- `run_membership`: joining, rejoining, and requests for missing messages
- `machine_transport`: the exchange with the soil over topics
- `command_subscriptions`, `command_scheduler`: commands; `command_conflicts`: several publishers
  that command the same machine
- `node_publishers`: all publications of the node, each at its rate; `machine_publishers`: those of
  one machine; `state_publishers` and `sensor_publishers`: its topics, created by
  `publisher_factory`; `shared_publishers`: those of the node
- `run_config`: the configuration that it publishes
- `machine_diagnostics`: diagnostics of the node and its machines

Only the modules with topics import ROS.
"""
