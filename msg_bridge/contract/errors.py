"""Errors of the package: each message says what is wrong and what to change."""

__all__ = ["EarthmovingError", "ExchangeError", "ParameterError"]


class EarthmovingError(ValueError):
    """Base of every error this package raises on bad input."""


class ParameterError(EarthmovingError):
    """A parameter is missing, unknown, of the wrong type or outside its range."""


class ExchangeError(EarthmovingError):
    """A message breaks the exchange between soil and machines; it changed nothing."""
