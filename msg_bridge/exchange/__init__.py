"""The exchange of volume between soil and machines: state machines without clock or network.

- `machine_side`, `soil_side`: the two ends; messages in by `receive`, out by `drain_outbox`
- `entry`: what a machine gathers to take part; `source`: what the soil holds of one that does
- `streams`: numbered rows, sent again until they have come
- `accounts`: soil in flight, pending, in particles, absent, outside
- `chunks`: rows cut into messages
- `direct`: carries the messages within one process
"""
