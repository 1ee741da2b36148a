"""Draft force of plane blades in dry sand, beside measured ones and those in a bed of spheres.

    python -m benchmarks.blade_draft [--resolve] [--chart FILE]

`blade` describes a drag and its result, `drag` drags the blade through the terrain of this project,
`sphere_drag` through spheres in LIGGGHTS, `measured` reads measured forces, `resolved` the recorded
ones of LIGGGHTS, `chart` draws both, and `__main__` prints the tables.

The measurements are of M. Obermayr, C. Vrettos, J. Kleinert and P. Eberhard, A Discrete Element
Method for assessing reaction forces in excavation tools, Fraunhofer ITWM report 228, 2013, section
3.1: upright steel blades of 0.2 and 0.3 m in washed sand, the mean force from 0.5 to 1.5 m of
travel, three tests each; see `validation/README.md` for how they were read.
"""
