"""Ticks of the exchange that machines took part in and that cannot be simulated again.

After a crash, some states of the physics engine cannot be restored exactly, see `physics_state`.
The machines then continue from the last state with the volume of soil that they hold by the
conversion rows since then, exact to the mm^3; poses and places of soil are those of that state.
"""

from __future__ import annotations

import numpy as np

from machine_sim.machine import MachineError
from machine_sim.simulation import MachineSim
from msg_bridge.contract.rows import ConversionKind, Rows

__all__ = ["book_conversions"]


def book_conversions(sim: MachineSim, conversions: Rows) -> None:
    """Give machines the soil that conversion rows leave them, without simulating their ticks.

    Excavated soil becomes pending. Deposited particles are removed; those that do not exist were
    released in the skipped ticks, from soil that is pending here.

    Args:
        sim: the machines in a state before the rows.
        conversions: CONVERSION rows of their node, in order.

    Raises:
        MachineError: the rows take more soil than the machines hold.
    """
    kind = conversions["kind"]
    is_excavated = kind == ConversionKind.EXCAVATE
    sim.credit_excavated_soil(conversions[is_excavated], 0)
    removed = conversions[~is_excavated & (kind != ConversionKind.REJECT)]
    exists = np.isin(removed["particle_id"], sim.particles.ids)
    sim.particles.remove(removed["particle_id"][exists])
    rest = int(removed["volume_mm3"][~exists].sum(dtype=np.int64))
    for coupling in sim.digging_couplings:
        rest -= coupling.pending.discard(rest)
    if rest:
        raise MachineError(f"conversion rows take {rest} mm^3 more than the machines hold")
