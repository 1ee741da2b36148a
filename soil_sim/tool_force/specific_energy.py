"""Specific energy of milling: the work of the picks for a volume of soil.

- **Rock.** A single pick cuts a groove of depth d. Goktan's peak force
  (`soil_sim.tool_force.rock_pick`) over the groove's section d^2 tan(beta) does not depend on d,

      e = m 4 pi sigma_t sin^2(a) / (cos(a) tan(beta)),    a = theta / 2 + psi,

  with the breakout angle beta and the ratio m of the mean to the peak force. For sigma_t = 3 MPa it
  is 8 MJ/m^3 or 2.2 kWh/m^3, within the measured range for a sandstone of 40 MPa at favourable
  spacing (Bilgin, Copur, Balci, Mechanical Excavation in Mining and Civil Industries, 2013, ch. 4).
- **Soil.** It fails passively and is lifted over the drum:
  e = 2 c sqrt(K_p) + gamma D, K_p = tan^2(pi/4 + phi/2). Loose soil is only lifted: e = gamma D.
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper, kernel
from soil_sim.tool_force.rock_pick import goktan_force

__all__ = ["firm_specific_energy", "loose_specific_energy", "rock_specific_energy"]

_PICK_TIP_ANGLE = math.radians(80.0)
"""Full tip angle of a pick [rad]."""
_PICK_FRICTION = math.radians(10.0)
"""Angle of friction between pick and rock [rad]."""
_BREAKOUT_ANGLE = math.radians(60.0)
"""Breakout angle of a groove, from the normal of the face [rad]."""
_MEAN_TO_PEAK_RATIO = 0.4
"""Ratio of the mean to the peak cutting force of a pick [-]: the force drops as chips break."""


@kernel
def rock_specific_energy(tensile_strength):  # type: ignore[no-untyped-def]
    """Return the specific energy [J/m^3] of rock under picks, from its tensile strength [Pa]."""
    return (
        _MEAN_TO_PEAK_RATIO
        * goktan_force(1.0, _PICK_TIP_ANGLE, tensile_strength, _PICK_FRICTION)
        / math.tan(_BREAKOUT_ANGLE)
    )


@helper
def firm_specific_energy(i, diameter, columns, strength):  # type: ignore[no-untyped-def]
    """Return the specific energy of the firm soil of a column [J/m^3].

    Args:
        i: flat index of the column.
        diameter: of the drum [m].
        columns: `ForceColumns` or `ColumnArrays` of the terrain.
        strength: `strength_table` of its kinds of soil.
    """
    kind = columns.soil[i]
    if strength[kind].tensile_strength > 0.0:
        return rock_specific_energy(strength[kind].tensile_strength)
    sqrt_k_p = math.tan(math.pi / 4 + 0.5 * strength[kind].phi)
    cohesion = strength[kind].cohesion[columns.moisture[i]]
    return 2.0 * cohesion * sqrt_k_p + strength[kind].gamma * diameter


@helper
def loose_specific_energy(i, diameter, columns, strength):  # type: ignore[no-untyped-def]
    """Return the specific energy of the loose soil of a column, of its bulk volume [J/m^3].

    Arguments as of `firm_specific_energy`.
    """
    bank_fraction = columns.loose[i] / columns.bulk[i]
    return strength[columns.loose_soil[i]].gamma * bank_fraction * diameter
