"""Auditing a bag: where all soil was at every tick, recomputed from what was recorded alone.

- `audit`: the whole, step by step
- `gather`: headers, rows and terrain maps of each epoch of a bag
- `ticks`, `window`: which machine header was taken when, and which ticks can be audited
- `streams`, `series`: numbered rows, and values over ticks
- `keyframes`, `terrain`: the terrain by conversion rows and cell by cell, against its maps
- `accounts`: pending, particles, in flight, absent, outside, against the ledger
- `landings`: each landed particle answered once
- `report`: what was found

Nothing here imports `msg_bridge.exchange`: an audit by the code that is audited proves nothing.
"""

from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.audit.report import AuditReport

__all__ = ["AuditReport", "audit_bag"]
