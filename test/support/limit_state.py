"""Passive earth pressure of soil without cohesion, exactly: Sokolovskii's limit state."""

from __future__ import annotations

import math
from functools import lru_cache

_STEPS = 2000
_MAX_ROUGHNESS = 0.998
"""Maximum delta over phi: at 1 the differential equations are singular at the face."""


@lru_cache
def exact_resistance(rake: float, phi: float, delta: float) -> float:
    """Return the push on a face below a level surface, over gamma d^2 / 2; angles in radians.

    Polar coordinates about the upper end of the face, r and theta from the surface downward. The
    mean stress is gamma r s(theta), and the major principal stress is at the angle psi(theta) to r.
    Equilibrium gives d(s, psi) / d theta. Soil next to the surface is in the passive state of
    Rankine, up to the direction theta_r of a slip line. The stress at the face is that for which
    psi is continuous there.
    """
    delta = min(delta, _MAX_ROUGHNESS * phi)
    k = math.sin(phi)
    omega = 0.5 * (delta + math.asin(math.sin(delta) / k))
    theta_r = math.pi / 4 - phi / 2
    high = 0.5
    while _excess_turn(high, omega, rake, theta_r, k) > 0.0:
        high *= 1.1
    low = high / 1.1
    for _ in range(30):
        middle = 0.5 * (low + high)
        if _excess_turn(middle, omega, rake, theta_r, k) > 0.0:
            low = middle
        else:
            high = middle
    normal = high * (1.0 + k * math.cos(2.0 * omega))
    return normal / (math.sin(rake) ** 2 * math.cos(delta))


def plane_resistance(rake: float, phi: float, delta: float) -> float:
    """Return the push of the trial wedge of least resistance, over gamma d^2 / 2."""
    planes = [math.radians(0.01 * n) for n in range(100, 9000)]
    return min(
        (1.0 / math.tan(rake) + 1.0 / math.tan(beta))
        * math.sin(beta + phi)
        / math.sin(rake + delta + phi + beta)
        for beta in planes
        if rake + delta + phi + beta < math.pi - 1e-3
    )


def curved_failure_ratio(rake: float, phi: float, delta: float) -> float:
    """Return the exact resistance over that of the trial wedge, 1 where nothing turns."""
    turn = 0.5 * (delta + math.asin(math.sin(delta) / math.sin(phi))) + rake - 0.5 * math.pi
    if turn <= 0.0:
        return 1.0
    return exact_resistance(rake, phi, delta) / plane_resistance(rake, phi, delta)


def _excess_turn(s: float, omega: float, rake: float, theta_r: float, k: float) -> float:
    """Return the angle of the major principal stress to the horizontal at theta_r, from the face.

    `s` is that at the face. Positive as well where the integration ends before theta_r.
    """
    theta, psi, step = rake, omega - 0.5 * math.pi, (theta_r - rake) / _STEPS
    for _ in range(_STEPS):
        ds1, dpsi1 = _derivatives(theta, s, psi, k)
        ds2, dpsi2 = _derivatives(
            theta + 0.5 * step, s + 0.5 * step * ds1, psi + 0.5 * step * dpsi1, k
        )
        s, psi, theta = s + step * ds2, psi + step * dpsi2, theta + step
        if s <= 0.0 or math.cos(2.0 * psi) > k + 1e-3 or abs(step * dpsi2) > 0.2:
            return math.inf
    return theta + psi


def _derivatives(theta: float, s: float, psi: float, k: float) -> tuple[float, float]:
    cos, sin = math.cos(2.0 * psi), math.sin(2.0 * psi)
    along = math.sin(theta) - s * (1.0 + 3.0 * k * cos)
    across = math.cos(theta) - 3.0 * k * s * sin
    divisor = k - cos
    ds = (along * sin - across * cos) / divisor
    return ds, (k * sin * across - (1.0 - k * cos) * along) / (2.0 * k * s * divisor)
