"""A whole run of one cycle on the demo's site: what it did, and whether it adds up."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from earthmoving_sim import cli, single_process_dig
from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.report import print_summary
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import SingleProcessDig

GIVEN_UP = {"approach": 0.0, "timeout": 9.0}


@pytest.fixture(scope="module")
def one() -> SimpleNamespace:
    """One cycle: the run, its outcome, and (phase, fill, ledger) of every tick."""
    run = SingleProcessDig(load_run_config("demo.yaml", {"cycles": 1, "approach": 0.5}))
    ticks = []
    step = run.world.step

    def watched():
        phase = run.operator.phase
        ledger = step()
        ticks.append((phase, run.machine.payload.fill, ledger))
        return ledger

    run.world.step = watched  # type: ignore[method-assign]
    outcome = run.run()
    yield SimpleNamespace(run=run, outcome=outcome, ticks=ticks)
    run.close()


@pytest.fixture(scope="module")
def short_runs() -> list[DigOutcome]:
    """Three runs given up in their first drag: the first two alike, the third of another seed."""
    outcomes = []
    for seed in (0, 0, 1):
        run = SingleProcessDig(load_run_config("demo.yaml", {**GIVEN_UP, "seed": seed}))
        outcomes.append(run.run())
        run.close()
    return outcomes


def test_run_finishes_its_cycle(one):
    assert not one.outcome.abort_reason
    assert one.outcome.is_balanced
    assert [cycle.number for cycle in one.outcome.cycles] == [1]


def test_every_tick_balances(one):
    assert one.outcome.max_imbalance == 0
    assert {ledger.imbalance for _, _, ledger in one.ticks} == {0}


def test_ledger_sums_to_the_soil_there_was(one):
    ledger = one.outcome.ledger
    assert ledger.total == ledger.start
    assert ledger.terrain == one.run.world.soil.total_mm3
    assert ledger.absent == ledger.outside == 0


def test_soil_is_really_in_hand_between_dig_and_dump(one):
    carried_fill = [ledger.particles for phase, _, ledger in one.ticks if phase == "swing"]
    assert min(carried_fill) > 500_000_000


def test_nothing_passes_through_bucket_or_ground(one):
    assert one.outcome.tunnelled == 0
    assert one.outcome.max_particles > 1000


def test_bucket_stays_full_on_its_way_to_the_dump(one):
    fills = [fill for phase, fill, _ in one.ticks if phase in ("lift", "swing")]
    assert min(fills) >= 0.80


def test_bucket_is_empty_after_the_dump(one):
    assert one.outcome.cycles[0].residual_fill < 0.02


def test_soil_said_to_be_moved_lies_at_the_dump(one):
    outcome = one.outcome
    y = outcome.grid.y(np.arange(outcome.grid.cols))
    rise = (outcome.after - outcome.site.heights)[:, y > 3.0].sum() * outcome.grid.cell**2
    bank = rise / (1.0 + one.run.config.soil.swell)
    # A little that was spilled on the way lies there, too.
    assert outcome.moved_volume == pytest.approx(bank, rel=0.05)


def test_terrain_grew_by_the_swell_of_the_soil_that_is_loose(one):
    outcome, swell = one.outcome, one.run.config.soil.swell
    grown = (outcome.after - outcome.site.heights).sum()
    assert grown == pytest.approx(outcome.loose_depth.sum() * swell / (1.0 + swell), rel=0.01)


def test_nothing_is_left_in_the_air_at_the_end(one):
    assert one.run.machine.particles.count == 0
    assert one.run.world.soil.relaxation.num_pending == 0


def test_path_of_the_lip_is_recorded(one):
    outcome = one.outcome
    assert outcome.lip_path.shape == (len(one.ticks) // 10, 3)
    assert outcome.lip_cycle.shape == outcome.lip_phase.shape == (len(outcome.lip_path),)
    dig = {"reach", "dig", "curl", "lift", "swing", "dump"}
    assert set(outcome.lip_phase) - {"done"} == {"approach", "brace", *dig, "settle"}
    assert set(outcome.lip_cycle) == {1}


def test_path_goes_through_the_dig_and_over_the_dump(one):
    path, phase, z = one.outcome.lip_path, one.outcome.lip_phase, one.outcome.lip_path[:, 2]
    assert z[phase == "dig"].min() < z[phase == "swing"].min() - 0.5
    assert path[phase == "dump", 1].min() > 3.0
    assert np.abs(path[phase == "dig", 1]).max() < 2.5


def test_machine_stands_where_it_drove_to(one):
    x, y = one.outcome.machine_position
    assert (x, y) == pytest.approx((-4.0, 0.0), abs=0.2)


def test_site_given_is_not_changed(one):
    assert not np.shares_memory(one.outcome.after, one.outcome.site.heights)
    assert (one.run.site.heights == single_process_dig.jacksboro_site().heights).all()


def test_rate_is_the_volume_of_an_hour(one):
    outcome = replace(one.outcome, moved_volume=2.0, simulated_time=60.0)
    assert outcome.production_rate == pytest.approx(120.0)


def test_summary_tells_the_balance_and_the_cycles(one, capsys):
    print_summary(one.outcome)
    said = capsys.readouterr().out
    assert "imbalance 0 mm3 at worst" in said
    assert f"moved     {one.outcome.moved_volume:.2f} bank m3" in said
    ticks = len(one.ticks)
    assert f"state     {one.outcome.state_hash} after tick {ticks}" in said
    assert "x real time, one process" in said
    assert "GIVEN UP" not in said


def test_summary_of_a_run_that_was_given_up_says_so(one, capsys):
    print_summary(replace(one.outcome, abort_reason="too long"))
    assert "GIVEN UP" in capsys.readouterr().out


@pytest.mark.parametrize("imbalance", [1, -1])
def test_lost_or_made_soil_is_not_balanced(one, imbalance):
    assert not replace(one.outcome, max_imbalance=imbalance).is_balanced


def test_unfinished_run_is_not_balanced(one):
    assert not replace(one.outcome, abort_reason="too long").is_balanced


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({}, 0),
        ({"max_imbalance": 1}, 1),
        ({"max_imbalance": -3}, 1),
        ({"abort_reason": "too long"}, 1),
    ],
)
def test_demo_exits_with_its_finding(one, change, code, monkeypatch, capsys, tmp_path):
    outcome = replace(one.outcome, **change)
    monkeypatch.setattr(SingleProcessDig, "__init__", lambda *_: None)
    monkeypatch.setattr(SingleProcessDig, "run", lambda *_, **__: outcome)
    monkeypatch.setattr(SingleProcessDig, "close", lambda _: None)
    assert cli.main(["demo", "--in-process", "--no-pictures", "--out", str(tmp_path)]) == code
    assert f"imbalance {outcome.max_imbalance} mm3" in capsys.readouterr().out


def test_same_run_again_gives_the_same_terrain(short_runs):
    first, again, _ = short_runs
    assert again.state_hash == first.state_hash
    assert (again.lip_path == first.lip_path).all()


def test_run_of_another_seed_gives_another_terrain(short_runs):
    first, _, other = short_runs
    assert first.loose_depth.sum() > 0.0
    assert other.state_hash != first.state_hash


def test_run_is_given_up_after_its_longest_time(short_runs):
    for outcome in short_runs:
        assert outcome.abort_reason
        assert outcome.max_imbalance == 0
        assert outcome.cycles == []
        assert GIVEN_UP["timeout"] <= outcome.simulated_time < GIVEN_UP["timeout"] + 4.0
