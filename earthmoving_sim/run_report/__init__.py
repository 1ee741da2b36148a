"""A report on what machines and soil did in a recording, as one HTML page with figures.

Modules in the order of use:

- `trace`: a value over time in bounded memory
- `way`: the way of a body in bounded memory
- `problems`: problems that nodes reported, by condition
- `run_data`: what is kept of a run
- `soil_handlers`, `machine_handlers`: what is kept of the messages of each topic
- `reading`: one pass over a bag, which fills the data of a run
- `terrain_history`: the terrain at the begin and the end of what is recorded
- `work_cycles`: cycles of a machine by its payload, with the times of dig, lift, swing and dump
- `latency`: time from a command to its effect
- `summary`: the figures of the report, also for JSON
- `charts`, `machine_charts`: the pictures
- `page`: the HTML page
- `report`: all of it
"""

from earthmoving_sim.run_report.report import Report, write_report

__all__ = ["Report", "write_report"]
