"""Machine simulation: machines in a physics engine, and excavated soil as particles.

- `machine`: a machine from a data file, in pybullet
- `ground`: copy of the terrain that tracks and particles touch
- `dem`: contact dynamics of soil particles; `reference_cubes`: the model of the 2014 reference
- `tool_soil`: sweeps, excavated soil, payload and resistance of each tool
- `simulated_machine`, `simulated_bin`: one machine with its tools and tracks; one bin
- `simulation`: one tick of all machines and particles; `params`: its stepping; `overlap_check`:
  of initial poses
- `endpoint`: the simulation behind its end of the exchange with the soil
- `sensors`: inertial units and encoders with their errors
- `commands`: commands from several sources, and the one that takes effect
- `node`: machines as a ROS 2 node
- `physics_engine`: pybullet without its banner; `warm_up`: compilation of all kernels

Outside of `node` it is independent of ROS. It does not import the soil simulation; both depend on
`msg_bridge.contract`.
"""
