"""The recorder: everything that is said on ROS topics, into a bag.

- `params`: what it records, and where
- `core`: what becomes of a message; knows no ROS
- `listening`: subscriptions to whatever is offered
- `node`: the node that finds topics and says how it goes
"""
