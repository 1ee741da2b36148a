"""The same dig in sand by this project and by a resolved discrete element method (LIGGGHTS).

    python -m benchmarks.resolved_dig [--spheres N] [--out FOLDER]

- `dig`: an excavator digs in sand; path and force of its bucket, and the ground that it leaves
- `liggghts_bed`: spheres of that sand, and the same bucket on the same path, for LIGGGHTS
- `comparison`: both as numbers and as a picture
"""
