"""Fixtures for all tests of nodes: the same that are there for users."""

from hypothesis import settings

pytest_plugins = ["msg_bridge.testing.fixtures"]

# An example that compiles a kernel first takes seconds; how long one takes is not what is tested.
settings.register_profile("no_deadline", deadline=None)
settings.load_profile("no_deadline")
