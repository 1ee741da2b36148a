"""metadata.yaml equals what rosbag2 of Jazzy writes for the same bag."""

import yaml
from rosbags.interfaces import QosDurability, QosHistory, QosLiveliness, QosReliability
from rosbags.rosbag2.metadata import parse_qos

from msg_bridge.bag.metadata import (
    BagMetadata,
    FileMetadata,
    OfferedQos,
    TopicMetadata,
    to_metadata_yaml,
    to_qos_yaml,
)

# All keys in the order of a rosbag2 recording.
EXPECTED = """\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: 250
  starting_time:
    nanoseconds_since_epoch: 1700000000000000000
  message_count: 5
  topics_with_message_count:
    - topic_metadata:
        name: /terrain/map
        type: sensor_msgs/msg/PointCloud2
        serialization_format: cdr
        offered_qos_profiles:
          - history: unknown
            depth: 0
            reliability: reliable
            durability: transient_local
            deadline:
              sec: 9223372036
              nsec: 854775807
            lifespan:
              sec: 9223372036
              nsec: 854775807
            liveliness: automatic
            liveliness_lease_duration:
              sec: 9223372036
              nsec: 854775807
            avoid_ros_namespace_conventions: false
        type_description_hash: RIHS01_abc
      message_count: 2
    - topic_metadata:
        name: /rosout
        type: rcl_interfaces/msg/Log
        serialization_format: cdr
        offered_qos_profiles:
          []
        type_description_hash: RIHS01_def
      message_count: 3
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - dig_0.mcap
  files:
    - path: dig_0.mcap
      starting_time:
        nanoseconds_since_epoch: 1700000000000000000
      duration:
        nanoseconds: 250
      message_count: 5
  custom_data: ~
  ros_distro: jazzy
"""

MAP = TopicMetadata(
    "/terrain/map",
    "sensor_msgs/msg/PointCloud2",
    "RIHS01_abc",
    (OfferedQos(durability="transient_local"),),
    2,
)
ROSOUT = TopicMetadata("/rosout", "rcl_interfaces/msg/Log", "RIHS01_def", (), 3)
START = 1_700_000_000_000_000_000


def bag_metadata(*topics, first=START, last=START + 250, custom=None) -> BagMetadata:
    count = sum(topic.count for topic in topics)
    return BagMetadata((FileMetadata("dig_0.mcap", first, last, count),), topics, custom or {})


def test_content_equals_that_of_rosbag2():
    assert yaml.safe_load(to_metadata_yaml(bag_metadata(MAP, ROSOUT))) == yaml.safe_load(EXPECTED)


def test_yaml_has_no_aliases():
    text = to_metadata_yaml(bag_metadata(MAP, MAP))
    assert "&" not in text
    assert "*" not in text


def test_bag_without_messages_starts_at_the_largest_time():
    content = yaml.safe_load(to_metadata_yaml(bag_metadata(first=None, last=None)))
    information = content["rosbag2_bagfile_information"]
    assert information["starting_time"] == {"nanoseconds_since_epoch": 2**63 - 1}
    assert (information["duration"], information["message_count"]) == ({"nanoseconds": 0}, 0)


def test_custom_data_are_strings_by_name():
    content = yaml.safe_load(
        to_metadata_yaml(bag_metadata(custom={"lost": '{"/a": 3}', "site": "Ø"}))
    )
    custom = content["rosbag2_bagfile_information"]["custom_data"]
    assert custom == {"lost": '{"/a": 3}', "site": "Ø"}


def test_offered_qos_is_preserved():
    offers = [
        OfferedQos(),
        OfferedQos(
            reliability="best_effort",
            durability="transient_local",
            history="keep_all",
            depth=7,
            liveliness="manual_by_topic",
            deadline=1_500_000_000,
            lifespan=2,
            lease=3_000_000_000,
        ),
    ]
    first, second = parse_qos(to_qos_yaml(offers))
    assert first.history is QosHistory.UNKNOWN
    assert first.reliability is QosReliability.RELIABLE
    assert second.history is QosHistory.KEEP_ALL
    assert second.depth == 7
    assert second.reliability is QosReliability.BEST_EFFORT
    assert second.durability is QosDurability.TRANSIENT_LOCAL
    assert second.liveliness is QosLiveliness.MANUAL_BY_TOPIC
    times = (second.deadline, second.lifespan, second.liveliness_lease_duration)
    assert [(each.sec, each.nsec) for each in times] == [(1, 500_000_000), (0, 2), (3, 0)]
