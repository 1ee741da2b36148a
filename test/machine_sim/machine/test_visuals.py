"""Visual shapes agree with the specification."""

import numpy as np

from machine_sim.machine.cylinder_visuals import cylinder_parts
from machine_sim.machine.forward_kinematics import link_frame_names
from machine_sim.machine.visuals import marker_boxes, shoe_visual


def test_visual_boxes_are_those_of_the_specification(spec):
    visuals = marker_boxes(spec)
    for frame, link in zip(link_frame_names(spec)[:4], list(spec.links.values())[:-1], strict=True):
        boxes = [(box.size, box.center, box.pitch) for box in visuals if box.link == frame]
        assert boxes == [(box.size, box.center, box.pitch) for box in link.boxes]


def test_visual_boxes_of_the_bucket_are_its_shell(spec):
    """Every plate has a box at its middle, and the opening has none."""
    boxes = [box for box in marker_boxes(spec) if box.link == "bucket"]
    middles = np.array([box.center for box in boxes])
    for plate in spec.bucket.plates()[:6]:
        assert np.linalg.norm(middles - plate.mean(axis=0), axis=1).min() < 1e-9
    assert {round(abs(y), 9) for y in middles[6:, 1]} == {
        0.5 * (spec.bucket.width + spec.bucket.plate_thickness)
    }


def test_links_and_cylinder_parts_have_boxes(spec):
    frames = {box.link for box in marker_boxes(spec)}
    parts = {part.link for part in cylinder_parts(spec)}
    assert frames == {*link_frame_names(spec)[: len(spec.links)], *parts}


def test_colours_are_in_range_and_differ(spec):
    colors = [*(box.color for box in marker_boxes(spec)), shoe_visual(spec).color]
    assert all(len(color) == 4 and all(0.0 <= part <= 1.0 for part in color) for color in colors)
    assert len(set(colors)) >= 3


def test_shoes_have_gaps_between_them(spec):
    visual, tracks = shoe_visual(spec), spec.tracks
    assert 0.9 * tracks.pitch < visual.shoe_size[0] < tracks.pitch
    assert visual.shoe_size[1:] == (tracks.shoe_width, tracks.shoe_thickness)
    assert (visual.shoe_count, visual.gauge) == (tracks.shoe_count, tracks.gauge)
