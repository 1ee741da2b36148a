"""Help for tests of this package and of yours against it.

- `fixtures`: pytest fixtures for tests of nodes without launch: `ros_domain`, `ros`, `ros_process`
- `ros`: what `ros` is; `process`: what `ros_process` makes; `domain`: a domain of one's own
- `lossy`: a transport that drops, duplicates, delays and reorders; needs no ROS, as all but the
  former do
"""

from msg_bridge.testing.lossy_transport import LossyTransport

__all__ = ["LossyTransport"]
