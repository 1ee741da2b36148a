"""Help for tests of this package and of yours against it."""

from msg_bridge.testing.lossy import LossyTransport

__all__ = ["LossyTransport"]
