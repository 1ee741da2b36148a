"""The ROS node of the soil. Only this folder of `soil_sim` imports ROS.

- `soil_node`: the node; `params`, `usage`: its parameters and help text
- `soil_run`: when a tick is due; `tick_scheduler`: the schedule in real time; `contention`: when
  other sessions requested to join as a machine (all without ROS)
- `soil_publishers`, `soil_transport`: its topics; `services`: its services; `soil_diagnostics`: its
  diagnostics
- `duplicate_soil_node`: detection of another soil node; `membership_log`: machines in the log
- `run_config`: contents of `sim/config`
"""
