"""Audit a bag: recompute from the recorded messages alone where all soil was at every tick.

Modules in the order of the computation:

- `bag_audit`: the whole audit, step by step
- `collect`: headers, rows, ledgers and terrain maps of each run in a bag
- `keyframes`: the terrain maps of a run, stored as differences
- `numbered_rows`: rows of a stream sorted by number, and the ranges that headers count
- `soil_ticks`: the soil's headers as arrays
- `membership`: which machine header the soil accepted in which tick
- `streams`: the rows of all streams of a run, sorted
- `audit_window`: which ticks are recorded completely and can be audited
- `segments`: the parts of a run between lost rows, which are audited one by one
- `completeness`: headers and rows that are missing, miscounted or contradictory
- `terrain_volume`: the terrain by conversion rows and cell by cell, compared with its maps
- `released_rows`: conversion rows that put down the soil of absent machines
- `machine_account_replay`: the accounts of one machine id, by its headers and conversion rows
- `accounts`: the accounts of every tick, compared with the published ledger
- `deposit_requests`: each deposit request has one answer, and backlogs are exact copies
- `differences`: one finding about a difference over many ticks
- `report`: the result

Nothing here imports `msg_bridge.exchange`: an audit must not use the code that it checks.
"""

from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.audit.report import AuditReport

__all__ = ["AuditReport", "audit_bag"]
