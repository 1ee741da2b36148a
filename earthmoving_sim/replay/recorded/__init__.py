"""What a bag has of the runs to replay.

- `run_survey`: which runs, sessions, configurations and state hashes there are
- `topic_queues`: the messages by topic, in the order of each topic
- `recorded_files`: the attached files of a run, in a folder
- `recorded_soil`, `recorded_node`: what the soil and a machine node did, tick by tick
- `soil_tick_inputs`: which machines took part in a tick of the soil, and how
"""
