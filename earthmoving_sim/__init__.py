"""The `earthmoving` command, a world in one process, the demo and its pictures.

- `cli`, `commands`: the command and its subcommands
- `environment`: checks of the computer
- `world`, `operated_machine`: soil and machines in one process, and a machine with its operator
- `config_layers`, `run_config`, `demo_site`: parameters and site of a run
- `single_process_dig`, `multi_process`: a run in one process, and with ROS nodes
- `dig_outcome`, `recorded_run`: outcome of a run, and the same from its recording
- `received_numbers`: numbers of rows, by which each counts once
- `coloured_mesh`, `machine_mesh`, `machine_outline`: the machine in pictures
- `pictures`, `report`: pictures and summary
"""
