"""Checkpoints: all state of a simulation as bytes, from which it continues to the last bit.

- `state_pickle`: a graph of objects as bytes, with arrays that share memory
- `state_file`: such bytes in a file, with version and checksum
"""
