"""SingleProcessDig: a run of one cycle on the demo's site, its outcome and its balance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dig_operator import LoadReport
from earthmoving_sim import cli, report, single_process_dig
from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.report import print_summary
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import SingleProcessDig

ABORTED = {"approach_distance": 0.0, "timeout": 9.0}


@pytest.fixture(scope="module")
def one() -> SimpleNamespace:
    """One cycle: the run, its outcome, and (phase, fill, ledger) of every tick."""
    run = SingleProcessDig(load_run_config("demo.yaml", {"cycles": 1, "approach_distance": 0.5}))
    ticks = []
    step = run.world.step

    def watched():
        phase = run.task.phase
        ledger = step()
        ticks.append((phase, run.machine.payload.fill, ledger))
        return ledger

    run.world.step = watched  # type: ignore[method-assign]
    outcome = run.run()
    yield SimpleNamespace(run=run, outcome=outcome, ticks=ticks)
    run.close()


@pytest.fixture(scope="module")
def short_runs() -> list[DigOutcome]:
    """Three runs aborted in their first drag: two with one seed, the third with another."""
    outcomes = []
    for seed in (0, 0, 1):
        run = SingleProcessDig(load_run_config("demo.yaml", {**ABORTED, "seed": seed}))
        outcomes.append(run.run())
        run.close()
    return outcomes


def test_run_finishes_its_cycle(one):
    assert not one.outcome.abort_reason
    assert one.outcome.is_successful
    assert [cycle.number for cycle in one.outcome.cycles] == [1]


def test_every_tick_balances(one):
    assert one.outcome.max_imbalance == 0
    assert {ledger.imbalance for _, _, ledger in one.ticks} == {0}


def test_ledger_sums_to_the_initial_volume(one):
    ledger = one.outcome.ledger
    assert ledger.total == ledger.start
    assert ledger.terrain == one.run.world.soil.total_mm3
    assert ledger.absent == ledger.outside == 0


def test_soil_is_carried_as_particles_during_the_swing(one):
    carried_volumes = [ledger.particles for phase, _, ledger in one.ticks if phase == "swing"]
    assert min(carried_volumes) > 0


def test_no_particle_tunnels(one):
    assert one.outcome.tunnelled == 0
    assert one.outcome.max_particles > 0


def test_bucket_is_full_when_it_is_carried_and_keeps_its_load(one):
    params, cycle = one.run.config.behaviour, one.outcome.cycles[0]
    assert cycle.carried_fill >= params.min_fill or cycle.num_passes == params.max_passes
    fills = [fill for phase, fill, _ in one.ticks if phase == "swing"]
    assert min(fills) >= 0.8 * cycle.carried_fill


def test_bucket_is_empty_after_the_dump(one):
    assert one.outcome.cycles[0].residual_fill < 0.02


def test_moved_volume_lies_at_the_dump(one):
    outcome = one.outcome
    y = outcome.grid.y(np.arange(outcome.grid.cols))
    rise = (outcome.after - outcome.site.heights)[:, y > 3.0].sum() * outcome.grid.cell**2
    bank = rise / (1.0 + one.run.config.soil.swell)
    # Some soil spilled during the swing lies there, too.
    assert outcome.moved_volume == pytest.approx(bank, rel=0.15)


def test_terrain_grows_by_the_swell_of_its_loose_soil(one):
    """Bucket and tracks compact a small part of it again."""
    outcome, swell = one.outcome, one.run.config.soil.swell
    grown = (outcome.after - outcome.site.heights).sum()
    growth = outcome.loose_depth.sum() * swell / (1.0 + swell)
    assert 0.93 * growth < grown < 1.001 * growth


def test_no_soil_is_in_motion_at_the_end(one):
    assert one.run.machine.particles.count == 0
    assert one.run.world.soil.relaxation.num_pending == 0


def test_path_of_the_lip_is_recorded(one):
    outcome = one.outcome
    assert outcome.lip_path.shape == (len(one.ticks) // 10, 3)
    assert outcome.lip_cycle.shape == outcome.lip_phase.shape == (len(outcome.lip_path),)
    dig = {"reach", "dig", "curl", "lift", "swing", "dump"}
    assert set(outcome.lip_phase) - {"done"} == {"approach", "brace", *dig, "settle"}
    assert set(outcome.lip_cycle) == {1}


def test_lip_path_passes_through_dig_and_dump(one):
    path, phase, z = one.outcome.lip_path, one.outcome.lip_phase, one.outcome.lip_path[:, 2]
    assert z[phase == "dig"].min() < z[phase == "swing"].min() - 0.5
    assert path[phase == "dump", 1].min() > 3.0
    assert np.abs(path[phase == "dig", 1]).max() < 2.5


def test_machine_stands_at_the_end_of_its_approach(one):
    x, y = one.outcome.machine_position
    assert (x, y) == pytest.approx((-4.0, 0.0), abs=0.2)


def test_pictures_count_no_cycle_that_was_aborted(short_runs, tmp_path, monkeypatch):
    records = []
    for name in ("draw_cut_fill", "draw_bucket_path", "draw_site_3d"):
        monkeypatch.setattr(report, name, lambda record, path: records.append(record))
    report.write_pictures(short_runs[0], tmp_path)
    assert set(short_runs[0].lip_cycle) == {1}
    assert [record.num_cycles for record in records] == [0, 0, 0]


def test_site_is_not_modified(one):
    assert not np.shares_memory(one.outcome.after, one.outcome.site.heights)
    assert (one.run.site.heights == single_process_dig.jacksboro_site().heights).all()


def test_production_rate_is_the_volume_per_hour_of_the_cycles(one):
    cycles = [replace(one.outcome.cycles[0], duration=duration) for duration in (20.0, 40.0)]
    outcome = replace(one.outcome, cycles=cycles, moved_volume=2.0, simulated_time=90.0)
    assert outcome.production_rate == pytest.approx(120.0)


def test_summary_of_loads_has_the_rate_of_loading_and_what_was_spilled(one, capsys):
    load = LoadReport(
        number=1, fill=0.8, hauled_volume=4.0, loading_time=100.0, duration=400.0, moved_volume=4.0
    )
    outcome = replace(one.outcome, loads=[load, replace(load, loading_time=92.0)])
    print_summary(outcome, "loam")
    summary = capsys.readouterr().out
    assert "; 150 m3/h while it was loaded\n" in summary
    assert "spilled" in summary
    print_summary(replace(outcome, abort_reason="out of reach"), "loam")
    assert "spilled" not in capsys.readouterr().out, "soil in the bed is not spilled"


def test_run_without_a_finished_cycle_has_no_production(short_runs):
    assert short_runs[0].production_rate == 0.0


def test_summary_has_soil_balance_and_state(one, capsys):
    print_summary(one.outcome, "loam")
    summary = capsys.readouterr().out
    assert "soil      loam" in summary
    assert "imbalance 0 mm3 at worst" in summary
    assert f"moved     {one.outcome.moved_volume:.2f} bank m3" in summary
    ticks = len(one.ticks)
    assert f"state     {one.outcome.state_hash} after tick {ticks}" in summary
    assert "x real time, one process" in summary
    assert "ABORTED" not in summary


def test_summary_of_an_aborted_run_has_the_reason(one, capsys):
    print_summary(replace(one.outcome, abort_reason="too long"), "loam")
    assert "ABORTED" in capsys.readouterr().out


@pytest.mark.parametrize("imbalance", [1, -1])
def test_imbalanced_run_is_not_balanced(one, imbalance):
    assert not replace(one.outcome, max_imbalance=imbalance).is_successful


def test_unfinished_run_is_not_balanced(one):
    assert not replace(one.outcome, abort_reason="too long").is_successful


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({}, 0),
        ({"max_imbalance": 1}, 1),
        ({"max_imbalance": -3}, 1),
        ({"abort_reason": "too long"}, 1),
    ],
)
def test_exit_code_of_the_demo_depends_on_the_outcome(
    one, change, code, monkeypatch, capsys, tmp_path
):
    outcome = replace(one.outcome, **change)
    monkeypatch.setattr(SingleProcessDig, "__init__", lambda *_: None)
    monkeypatch.setattr(SingleProcessDig, "run", lambda *_, **__: outcome)
    monkeypatch.setattr(SingleProcessDig, "close", lambda _: None)
    assert cli.main(["demo", "--in-process", "--no-pictures", "--out", str(tmp_path)]) == code
    assert f"imbalance {outcome.max_imbalance} mm3" in capsys.readouterr().out


def test_runs_with_one_seed_are_identical(short_runs):
    first, again, _ = short_runs
    assert again.state_hash == first.state_hash
    assert (again.lip_path == first.lip_path).all()


def test_runs_with_different_seeds_differ(short_runs):
    first, _, other = short_runs
    assert first.loose_depth.sum() > 0.0
    assert other.state_hash != first.state_hash


def test_run_is_aborted_after_its_timeout(short_runs):
    for outcome in short_runs:
        assert outcome.abort_reason
        assert outcome.max_imbalance == 0
        assert outcome.cycles == []
        assert ABORTED["timeout"] <= outcome.simulated_time < ABORTED["timeout"] + 4.0


def test_progress_names_what_an_operator_waits_for(monkeypatch, capsys):
    run = SingleProcessDig(load_run_config("demo.yaml", {**ABORTED, "timeout": 1.0}))
    monkeypatch.setattr(type(run.task), "wait_reason", "the truck")
    run.run(progress=True)
    run.close()
    assert "x real time  excavator waits for the truck\n" in capsys.readouterr().out
