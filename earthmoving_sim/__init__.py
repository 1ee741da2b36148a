"""What users run: the `earthmoving` command and worlds in one process.

- `cli`: the command; `demo`, `check`: its subcommands
- `world`: soil and machines in lockstep over the direct transport
- `run_config`, `site`, `dig_run`, `report`: a run of the scripted operator, start to summary
- `pictures`, `machine_shape`: what it looked like
"""
