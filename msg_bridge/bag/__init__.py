"""Write and read ROS 2 bags in MCAP files.

Modules in the order of use:

- `message_schemas`: definition and hash of a message type, from its installed files
- `metadata`: metadata.yaml of a bag, and the QoS that publishers offered
- `mcap_records`: layout of the records of an MCAP file
- `mcap_file`: writes one MCAP file
- `atomic_file`: a file in which each write succeeds completely or leaves no trace
- `bag_file`: one file of a bag being written, with all topics of the bag
- `writer`: writes one bag into a folder, readable up to its last chunk at any time
- `message_loss`: counts messages and rows that were sent and not received
- `compressed_message`: decompresses messages that were compressed one by one
- `mcap_index`: finds the chunks and messages of an MCAP file, finished or not
- `bag_files`: the MCAP files of a bag
- `terrain_deltas`: topics on which terrain maps are recorded as deltas, and the maps they restore
- `merged_messages`: the messages of all files, in the order of their log times
- `message_index`: random access to messages by their number
- `legacy_names`: old and current names of topics, fields, labels and keys
- `legacy_messages`: renames what format 1 named otherwise in messages
- `reader`: reads bags of all formats, finished or not

Modules are imported by name: writing needs no rclpy, reading does.
"""

__all__: list[str] = []
