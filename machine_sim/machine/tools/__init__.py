"""Tools: what of a machine touches soil.

- `trough`: what `bucket` and `bed` have in common; `drum`: what mills
- `shapes`: all of them, and the link that each is fixed to
- `boxes`: what is seen of them, and what other rigid machines touch
- `tool`: one in pybullet
"""
