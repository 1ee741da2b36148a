"""Teleoperation of a machine: levers and pedals from keys, published as `sensor_msgs/Joy`.

- `key_layout`: which key deflects which lever or pedal
- `levers`: deflections of levers and pedals from the keys that are held
- `joy_axes`: deflections as the axes and buttons of a `Joy` message
- `terminal_keys`: keys that are held, from the bytes that a terminal sends
- `terminal`: the terminal in the mode that teleoperation needs
- `terminal_page`: the lines that the terminal shows
- `node`: the ROS node; only this module loads rclpy
"""
