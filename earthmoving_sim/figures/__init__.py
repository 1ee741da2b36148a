"""Pictures after the figures of the reference of 2014: simulated scenes, drawn by the live page.

- `soil_scene`, `world_scene`: what the page shows of a soil or a world of one process
- `operated_world`: machines with operators on a site
- `studio`: takes pictures of them
- `piles`, `digging`, `machine_counts`, `resolution`: the scenes
- `charts`: measured speeds beside those of the reference
- `figure`, `catalogue`, `contact_sheet`: all figures, their captions and measured values
"""
