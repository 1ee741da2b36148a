"""What a run ends with: a summary in words and pictures."""

from __future__ import annotations

from pathlib import Path

from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.pictures import SiteRecord, draw_bucket_path, draw_cut_fill, draw_site_3d

__all__ = ["print_summary", "write_pictures"]


def print_summary(outcome: DigOutcome) -> None:
    """Print what was moved, how fast, and whether it adds up."""
    print("cycle  passes  planned m3  carried %  dumped %  left %  time s")
    for c in outcome.cycles:
        print(
            f"{c.number:5d}  {c.num_passes:6d}  {c.planned_volume:10.2f}  {100 * c.carried_fill:9.0f}"
            f"  {100 * (c.delivered_fill - c.residual_fill):8.0f}  {100 * c.residual_fill:6.1f}  {c.duration:6.1f}"
        )
    ledger = outcome.ledger
    print(
        f"\n  moved     {outcome.moved_volume:.2f} bank m3 in {outcome.simulated_time:.1f} s of simulated time"
    )
    print(f"  rate      {outcome.production_rate:.0f} m3/h")
    print(f"  speed     {outcome.real_time_factor:.1f} x real time, {outcome.run_mode}")
    print(f"  particles {outcome.max_particles} at most, {outcome.tunnelled} tunnelled")
    print(
        f"  ledger    terrain {ledger.terrain - ledger.start:+d}, in flight {ledger.in_flight},"
        f" pending {ledger.pending}, particles {ledger.particles}, absent {ledger.absent},"
        f" outside {ledger.outside} mm3"
    )
    if outcome.tunnelled:
        print("  WARNING   particles went through the bucket or the ground")
    print(f"  imbalance {outcome.max_imbalance} mm3 at worst, in any tick")
    print(f"  state     {outcome.state_hash} after tick {outcome.state_tick}")
    if outcome.abort_reason:
        done = _counted(len(outcome.cycles), "cycle")
        print(f"  ABORTED after {done}: {outcome.abort_reason}")


def write_pictures(outcome: DigOutcome, folder: Path) -> list[Path]:
    """Draw the terrain before and after, the bucket's path and the site; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    record = SiteRecord(
        grid=outcome.grid,
        before=outcome.site.heights,
        after=outcome.after,
        loose_depth=outcome.loose_depth,
        lip_path=outcome.lip_path,
        lip_cycle=outcome.lip_cycle,
        lip_phase=outcome.lip_phase,
        machine_outline=outcome.machine_outline,
        machine_faces=outcome.machine_faces,
        machine_position=outcome.machine_position,
        title=f"{outcome.moved_volume:.2f} bank m³ moved in {_counted(len(outcome.cycles), 'cycle')}",
    )
    return [
        draw_cut_fill(record, folder / "cut_fill.png"),
        draw_bucket_path(record, folder / "bucket_path.png"),
        draw_site_3d(record, folder / "site.png"),
    ]


def _counted(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
