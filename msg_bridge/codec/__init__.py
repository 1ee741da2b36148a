"""What crosses, as messages that any ROS 2 machine knows; nothing else packs bytes.

- `point_cloud`: rows as PointCloud2
- `cdr`: row clouds and arrays straight to bytes and back, for the many of a tick
- `chunks`: chunks of rows, with the run and the life they belong to
- `headers`: headers, requests, refusals and the ledger
- `grid_map`: the same as grid_map_msgs/GridMap, where that is installed
- `terrain`: the whole terrain surface as cloud, image and map info
- `cut_fill`: what is still to dig and to fill
- `machine_state`: a machine's joints, commands and payload
- `poses`: odometry, transforms, wrench
- `markers`: the machine for viewers that know no TF
- `particles`: its particles as cloud
- `rotations`: matrices and angles of quaternions
- `stamps`: simulation time, exact
- `qos`: the quality of service of each kind of topic; needs rclpy
- `errors`: what a malformed message raises
"""
