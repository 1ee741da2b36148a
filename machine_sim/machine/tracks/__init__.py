"""Tracks: two belts of shoes on deformable ground, in two models with one interface.

In the order in which a step uses them:

- `track_model`: the interface `Tracks`, and the choice of the model
- `placement`: initial pose of a machine on the ground
- `track_state`: parameters and state, as the kernels take them
- `track_base`: what both models share
- `kinematic`, `kinematic_step`: one degree of freedom for each belt, shoes on their path
- `dynamic`, `dynamic_step`: rigid shoes, hinged and driven by the sprocket
- `undercarriage`, `rail_support`, `axle_support`: rail, carriers, flanges and brake of the dynamic
  tracks, and their stiff support on the ground below rail and axles
- `running_gear`, `shoe_chain`: sprockets, idlers and shoes of the dynamic tracks in pybullet
- `rigid_body`: vectors, rotations and wrenches in kernels
- `bristle_contact`: depth, bristle force and sliding of one contact point
- `terramechanics`: bearing capacity and shear strength of the soil under a sole
- `shoe_contact`, `axle_contact`, `body_contact`: forces on shoes, below axles, and on the main body
- `track_slip`: slip from moving averages of the speeds
"""

from machine_sim.machine.tracks.dynamic import DynamicTracks
from machine_sim.machine.tracks.kinematic import KinematicTracks
from machine_sim.machine.tracks.placement import standing_pose
from machine_sim.machine.tracks.track_model import (
    TRACK_MODELS,
    ShoeTable,
    SoleContact,
    TrackModel,
    Tracks,
    sole_contact,
    with_track_model,
)

__all__ = [
    "TRACK_MODELS",
    "DynamicTracks",
    "KinematicTracks",
    "ShoeTable",
    "SoleContact",
    "TrackModel",
    "Tracks",
    "sole_contact",
    "standing_pose",
    "with_track_model",
]
