"""All that crosses between soil, machines and the world.

- `contract`: what both sides agree on: grid, rows, messages, ledger, parameters
- `exchange`: the state machines at both ends, the accounts, the direct transport
- `codec`: the same as ROS 2 messages, and their QoS; `dds`: the shipped Fast DDS profile
- `testing`: help for tests, a bad transport among it
- `config_files`: where shipped parameters are
"""
