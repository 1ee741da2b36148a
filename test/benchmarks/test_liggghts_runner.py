"""Input files written for LIGGGHTS, and its output read."""

import numpy as np
import pytest

from benchmarks import liggghts_runner
from benchmarks.liggghts_runner import (
    ContactCoefficients,
    LiggghtsError,
    Spheres,
    data_text,
    drop_spheres,
    input_text,
    is_installed,
    last_positions,
    loop_seconds,
    rayleigh_time,
    substeps,
)

# Output of LIGGGHTS 3.8.0 of Debian, shortened; the last run writes the dump.
OUTPUT = """\
Setting up run at Sat Nov 21 22:55:49 2026

Memory usage per processor = 18.9604 Mbytes
    Step    Atoms         KinEng
       0     5000              0
     600     5000      5553.4615
Loop time of 0.789738 on 1 procs for 600 steps with 5000 atoms, finish time Sat Nov 21 22:55:50 2026


Pair  time (%) = 0.323512 (40.9645)
Neigh time (%) = 0.388307 (49.1691)

Total # of neighbors = 21929
Neighbor list builds = 106
Dangerous builds = 0
Setting up run at Sat Nov 21 22:55:50 2026

    Step    Atoms         KinEng
     600     5000      5553.4615
    3600     5000  0.00028137727
Loop time of 5.59386 on 1 procs for 3000 steps with 5000 atoms, finish time Sat Nov 21 22:55:56 2026

Neighbor list builds = 221
Dangerous builds = 0
Loop time of 1.2e-06 on 1 procs for 0 steps with 5000 atoms, finish time Sat Nov 21 22:55:56 2026
"""
PARTS = [600, 3000]

DUMP = """\
ITEM: TIMESTEP
3600
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS ss ss ss
-1 1
-1 1
0 1
ITEM: ATOMS id x y z
2 0.25 -0.5 0.0415
1 -0.125 0 0.0415
"""


def spheres() -> Spheres:
    """Return a large and a small sphere, apart, 0.1 m above the ground."""
    return Spheres(
        position=np.array([[0.0, 0.0, 0.15], [0.2, 0.2, 0.14]]),
        radius=np.array([0.05, 0.04]),
        density=np.full(2, 2600.0),
        gravity=9.81,
        particle_contact=ContactCoefficients(0.3, 0.05, 0.7),
        ground_contact=ContactCoefficients(0.7, 0.4, 0.4),
    )


def test_wall_time_of_each_part_is_read_from_the_output() -> None:
    assert loop_seconds(OUTPUT, PARTS, 5000) == [0.789738, 5.59386]


@pytest.mark.parametrize(
    ("output", "parts", "count", "message"),
    [
        (OUTPUT, [600, 3000, 100], 5000, "did not run"),
        (OUTPUT[: OUTPUT.index("Loop time")] + "ERROR: no such fix", PARTS, 5000, "no such fix"),
        (OUTPUT, PARTS, 5001, "lost"),
        (OUTPUT.replace("Dangerous builds = 0", "Dangerous builds = 3"), PARTS, 5000, "skin"),
    ],
)
def test_failed_run_is_an_error(output: str, parts: list[int], count: int, message: str) -> None:
    with pytest.raises(LiggghtsError, match=message):
        loop_seconds(output, parts, count)


def test_positions_are_in_the_order_of_the_data_file() -> None:
    np.testing.assert_array_equal(
        last_positions(DUMP, 2), [[-0.125, 0.0, 0.0415], [0.25, -0.5, 0.0415]]
    )
    assert last_positions(DUMP + DUMP.replace("0.0415", "0.06"), 2)[0, 2] == 0.06


@pytest.mark.parametrize(("dump", "count"), [("", 2), (DUMP, 3), (DUMP[:-12], 2)])
def test_incomplete_dump_is_an_error(dump: str, count: int) -> None:
    with pytest.raises(LiggghtsError, match=f"of {count} spheres"):
        last_positions(dump, count)


def test_data_file_has_diameters_and_a_box_around_all_spheres() -> None:
    head, rows = data_text(spheres()).split("\n\nAtoms\n\n")
    assert "2 atoms" in head
    assert "2 atom types" in head
    table = np.array([row.split() for row in rows.split("\n") if row], dtype=float)
    np.testing.assert_allclose(
        table, [[1, 1, 0.1, 2600.0, 0.0, 0.0, 0.15], [2, 1, 0.08, 2600.0, 0.2, 0.2, 0.14]]
    )
    bounds = [line.split()[:2] for line in head.splitlines() if line.endswith("hi")]
    low, high = np.array(bounds, dtype=float).T
    assert (low < table[:, 4:].min(axis=0) - 0.05).all()
    assert (high > table[:, 4:].max(axis=0) + 0.05).all()


def test_script_has_the_parts_and_the_coefficients_of_ground_and_spheres() -> None:
    lines = input_text(spheres(), 0.001, PARTS).splitlines()
    assert [line for line in lines if line.startswith("run")] == ["run 600", "run 3000", "run 0"]
    assert "timestep 0.001" in lines
    friction = next(line for line in lines if "coefficientFriction" in line)
    assert friction.endswith("peratomtypepair 2 0.3 0.7 0.7 0.7")


def test_time_step_is_at_most_a_fifth_of_the_rayleigh_time() -> None:
    # Density 2600 kg/m^3 and shear modulus 2.5 MPa / 1.3: waves of 27.2 m/s.
    assert rayleigh_time(0.05, 2600.0, 5e6) == pytest.approx(0.00624, rel=0.01)
    for young in (5e6, 1e7, 1e8):
        n = substeps(spheres(), 0.005, young)
        assert 0.005 / n <= 0.2 * rayleigh_time(0.04, 2600.0, young) < 0.005 / (n - 1)


def test_missing_program_is_an_error_that_names_the_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(liggghts_runner, "PROGRAM", "no-such-program")
    with pytest.raises(LiggghtsError, match="apt-get install liggghts"):
        drop_spheres(spheres(), 0.001, [1])


@pytest.mark.skipif(
    not is_installed(), reason="LIGGGHTS is not installed: apt-get install liggghts"
)
def test_spheres_fall_and_come_to_rest_on_the_ground() -> None:
    start, flight = spheres(), 100  # steps of 1 ms
    outcome = drop_spheres(start, 0.001, [flight])
    fallen = start.position[:, 2] - 0.5 * 9.81 * (1e-3 * flight) ** 2
    np.testing.assert_allclose(outcome.position[:, 2], fallen, atol=0.001)
    outcome = drop_spheres(start, 0.001, [flight, 1500])
    assert len(outcome.seconds) == 2
    assert min(outcome.seconds) > 0.0
    np.testing.assert_allclose(outcome.position[:, :2], start.position[:, :2], atol=1e-6)
    np.testing.assert_allclose(outcome.position[:, 2], start.radius, atol=0.002)
