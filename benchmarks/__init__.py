"""Measure speed and accuracy: each module is run as `python -m benchmarks.MODULE`.

Soil: `soil_step_cost` (with `reference_soil`, the method of 2014, as baseline), `soil_gallery`
(pictures of the terrains of `soil_scenes`).
Particles: `particle_step_cost`, `particle_feature_cost`, `cubes_in_box` and `liggghts_comparison`
(with `liggghts_runner`), on the scenes of `particle_scenes`; `validation` repeats laboratory
experiments, `resolved_dig` a dig in LIGGGHTS.
Machines: `driving_performance`, `random_digging`, `machine_count_scaling`, `dig_cycle_cost`,
`machine_gallery` (pictures).
Exchange: `node_performance`, `message_codec`, `record_fixture_bag`.
Changes of the code: `compare` measures two checkouts side by side, `state_hashes` (with
`state_hash_scenes`) shows that results are the same to the last bit.
Shared: `result_table` (tables and JSON lines), `timing`, `bucket_sweeps`.
"""
