"""Visual shapes: what a machine looks like, as meshes with materials; no effect on the physics.

- `machine_shapes`: shapes, materials and view points of a machine, from its file
- `shape`, `materials`: kinds of shapes that a file can name, and the shared materials
- `solids`, `outline`, `curves`: meshes of elementary bodies, and the plane outlines they start from
- `triangle_mesh`, `solid`: closed meshes, their normals, and bodies with a material
- `bucket_solids`, `bed_solids`, `drum_solids`, `tool_solids`: bodies of tools from their dimensions
- `cylinder_solids`, `track_solids`: bodies of cylinders, rockers, track frames, wheels and shoes
- `link_meshes`, `posed_mesh`: mesh of each link, and of the whole machine in a pose
- `glb`: meshes as binary glTF
"""
