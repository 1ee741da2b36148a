"""What the live page shows: plain Python and NumPy, without ROS and without a web server.

- `terrain_tiles`: layers of the surface by tile, with a counter of changes
- `terrain_surface`: the surface of one run, kept equal to its topics
- `particle_cloud`: particles in the layout that the page draws
- `machine_model`, `urdf`: links, joints and shapes of a machine, from its URDF
- `machine_view`: what is known of one machine
- `scene`: Scene: all of these, with a lock
"""
