"""Laboratory experiments with particles, compared with published laws and the soil's parameters.

    python -m benchmarks.validation [--quick] [--chart FILE]

`bucket_transport` and `full_speed_scoop` (with `plate_tunnelling`) test soil in a bucket,
`hopper_outflow` Beverloo's law, `angle_of_repose` poured heaps, `heap_creep` a heap at rest, and
`column_collapse` the runout laws of Lube et al. `experiment_setup` has what they share, `chart`
the figure, and `__main__` the table of all.
"""
