"""Subcommands of `earthmoving`, one module each.

A module has

- `SUMMARY: str`, one line for the list in `--help`;
- `add_arguments(parser: argparse.ArgumentParser) -> None`, which adds its options;
- `run(args: argparse.Namespace) -> int`, which does the work and returns the exit code.

Its docstring is the description in its `--help`. All modules are imported to build `--help`, so
they import heavy packages (NumPy, rclpy) only in `run`.
"""
