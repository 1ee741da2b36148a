"""Sources of what the live page shows.

- `scene_writer`: sets a Scene from ROS messages of public topics
- `machine_topics`: which machines there are, by the names of topics
- `machine_files`: the machine file that a configuration names
- `polled_subscriptions`: subscriptions that come and go
- `live`: subscriptions of a node
- `bag_scene`, `bag_terrain`, `bag_timeline`, `bag_player`: the same from a bag
- `bag_folder`: the bags that clients may open
"""
