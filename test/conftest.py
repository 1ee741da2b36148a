"""Fixtures for tests of nodes: those that users have."""

import os

from hypothesis import settings

from msg_bridge.kernels.fixed_signature import CHECK_VARIABLE

pytest_plugins = ["msg_bridge.testing.fixtures"]

os.environ[CHECK_VARIABLE] = "1"

# An example that compiles a kernel takes seconds; durations are not tested.
settings.register_profile("no_deadline", deadline=None)
settings.load_profile("no_deadline")
