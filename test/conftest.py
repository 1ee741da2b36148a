"""Fixtures for all tests of nodes: the same that are there for users."""

pytest_plugins = ["msg_bridge.testing.fixtures"]
