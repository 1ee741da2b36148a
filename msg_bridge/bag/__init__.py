"""ROS 2 bags in MCAP files, written and read.

- `schemas`: the full text and the hash of a message type, from its installed files
- `writer`: one bag in a folder, readable whenever it breaks off
- `metadata`: its metadata.yaml, and what publishers offered
- `gaps`: messages and rows that were sent and did not arrive
- `reader`: reads bags, whole or broken off
"""
