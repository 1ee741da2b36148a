"""Fixtures for tests of nodes: those that users have."""

from hypothesis import settings

pytest_plugins = ["msg_bridge.testing.fixtures"]

# An example that compiles a kernel takes seconds; durations are not tested.
settings.register_profile("no_deadline", deadline=None)
settings.load_profile("no_deadline")
