"""All that crosses between soil, machines and the world.

- `contract`: what both sides agree on: grid, rows, messages, ledger, parameters
- `exchange`: the state machines at both ends, the accounts, the direct transport
- `codec`: the same as ROS 2 messages, and their QoS; `dds`: the shipped Fast DDS profile
- `nodes`: what the nodes are made of: running, parameters, diagnostics, the exchange over topics
- `bag`: MCAP bags, written and read; `recorder`: the node that writes them; `audit`: every cubic
  millimetre of a recorded run counted again
- `testing`: fixtures for launch-free tests of nodes, a bad transport
- `kernels`: how Numba kernels are compiled and cached
- `config_files`: where shipped parameters are
"""
