"""Reference motion of a joint: ramps, and the stop before its angle limit."""

import numpy as np

from machine_sim.machine.joint_reference import JointReference
from machine_sim.machine.spec import JointLimits

DT = 0.005
ACCELERATION, END_DECELERATION = 1.3, 3.0


def test_joint_brakes_harder_before_its_limit_than_it_accelerates():
    limits = JointLimits(-1.0, 1.0, 1.0, 0.9, ACCELERATION, END_DECELERATION)
    reference = JointReference([limits], np.array([-1.0]))
    reference.command, rates, angle = [0.9], [0.0], -1.0
    while rates[-1] > 0.0 or len(rates) < 10:
        reference.advance(DT, [angle], [rates[-1]])
        angle, rate = reference.angle[0], reference.rate[0]
        rates.append(rate)
    changes = np.diff(rates) / DT
    assert 1.0 - angle < 1e-3
    assert np.isclose(changes.max(), ACCELERATION)
    assert np.isclose(changes.min(), -END_DECELERATION, rtol=0.15)
