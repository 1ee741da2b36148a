"""Tracks: two belts of shoes, on ground that gives, in two models behind one interface.

- `model`: what both models have in common, and how a machine is set down
- `shoe`: what one shoe feels of the soil it stands on
- `fast`, `contact`: belts on their path
- `hinged`, `chain`, `gear`, `hinged_contact`: rigid shoes, hinged and driven by the sprocket
"""
