"""Images of cameras on machines, as ROS topics.

- `camera_info`: intrinsic matrices of a rendered picture
- `params`, `usage`: parameters of the node
- `picture_worker`: draws the pictures in a thread of its own
- `node`: CameraNode: publishes images and camera infos
"""
