"""What users run: the `earthmoving` command, a world in one process, the demo and its pictures.

- `cli`: the command; its subcommands are `demo`, `audit`, `check`
- `world`: soil and machines in one process
- `dig_run`, `as_nodes`: a run of the scripted operator, in one process and as nodes
- `outcome`, `from_bag`: what a run did, as told by the run itself and by its bag
- `report`, `pictures`: the same for people
- `run_config`, `site`, `machine_shape`: parameters of a run, its ground, the machine's looks
"""
