"""Machines, and soil as particles."""
