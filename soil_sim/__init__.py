"""Soil as height volume."""
