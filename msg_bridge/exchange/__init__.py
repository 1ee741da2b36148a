"""The exchange state machine."""
