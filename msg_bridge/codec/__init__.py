"""Encode and decode what crosses between processes as standard ROS 2 messages.

- `errors`: the error of malformed messages
- `point_cloud`: rows as PointCloud2
- `labelled_array`, `array_labels`: named values as arrays; labels of encoded dataclasses
- `json_object`: JSON objects with fixed names and types
- `cdr_primitives`: byte order, stamps and strings in serialised messages
- `cloud_layout`: fields and rows of a serialised PointCloud2
- `cdr`: row clouds and arrays serialised without message objects
- `row_chunks`: chunks of rows with run and session
- `tick_headers`: headers, requests, rejections and the ledger
- `state_hash`: the hash of a state after a tick
- `terrain`, `grid_estimation`: the terrain surface as a cloud, and the grid of its points
- `terrain_images`, `grid_map`: the same as images, and as grid_map_msgs/GridMap
- `cut_fill`: volume still to cut and to fill
- `machine_state`: joints, commands, payload, cylinders and tracks
- `poses`, `rotations`: odometry, transforms, wrench; rotation matrices and angles
- `sensors`: inertial units and encoders
- `markers`: a machine for viewers without TF
- `particles`: particles as a cloud
- `run_config`: the configuration of a run
- `stamps`: exact simulation time
- `status_levels`: names of the levels of diagnostics
- `qos`: QoS profiles; needs rclpy

Modules are imported by name, so that a reader of one kind of message needs only its packages.
"""

__all__: list[str] = []
