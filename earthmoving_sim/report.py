"""Summary of a run as text, and its pictures."""

from __future__ import annotations

from pathlib import Path

from earthmoving_sim.dig_outcome import DigOutcome
from earthmoving_sim.pictures import SiteRecord, draw_bucket_path, draw_cut_fill, draw_site_3d

__all__ = ["print_summary", "write_pictures"]


def print_summary(outcome: DigOutcome, soil: str) -> None:
    """Print the cycles, the volume moved, the speed and the balance of volume.

    Args:
        outcome: the outcome of the run.
        soil: description of the soil.
    """
    print("cycle  passes  planned m3  carried %  dumped %  left %  time s")
    for c in outcome.cycles:
        print(
            f"{c.number:5d}  {c.num_passes:6d}  {c.planned_volume:10.2f}"
            f"  {100 * c.carried_fill:9.0f}  {100 * (c.delivered_fill - c.residual_fill):8.0f}"
            f"  {100 * c.residual_fill:6.1f}  {c.duration:6.1f}"
        )
    if outcome.loads:
        print("load  fill %  hauled m3  tipped m3  loading s  round s")
        for load in outcome.loads:
            print(
                f"{load.number:4d}  {100 * load.fill:6.0f}  {load.hauled_volume:9.2f}"
                f"  {load.moved_volume:9.2f}  {load.loading_time:9.1f}  {load.duration:7.1f}"
            )
    ledger = outcome.ledger
    print(f"\n  soil      {soil}")
    print(
        f"  moved     {outcome.moved_volume:.2f} bank m3 in {outcome.simulated_time:.1f} s of"
        " simulated time"
    )
    rate = f"{outcome.production_rate:.0f} m3/h during the cycles"
    if outcome.loads:
        rate += f", with waits for the truck; {outcome.loading_rate:.0f} m3/h while it was loaded"
    print(f"  rate      {rate}")
    if outcome.loads and not outcome.abort_reason:  # the bed of an aborted run may hold soil
        print(f"  spilled   {100 * outcome.spilled_fraction:.1f} % of it beside the truck")
    print(f"  speed     {outcome.real_time_factor:.1f} x real time, {outcome.run_mode}")
    print(f"  particles {outcome.max_particles} at most, {outcome.tunnelled} tunnelled")
    print(
        f"  ledger    terrain since the start {ledger.terrain - ledger.start:+d} mm3; not in the"
        f" terrain: in flight {ledger.in_flight}, pending {ledger.pending},"
        f" particles {ledger.particles}, absent {ledger.absent}, outside {ledger.outside} mm3"
    )
    if outcome.tunnelled:
        print("  WARNING   particles went through the bucket or the ground")
    print(f"  imbalance {outcome.max_imbalance} mm3 at worst, in any tick")
    print(f"  state     {outcome.state_hash} after tick {outcome.state_tick}")
    if outcome.abort_reason:
        print(f"  ABORTED   after {_counted(len(outcome.cycles), 'cycle')}: {outcome.abort_reason}")


def write_pictures(outcome: DigOutcome, folder: Path) -> list[Path]:
    """Draw cut and fill, the path of the bucket and the site in 3-D; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    num_cycles = _counted(len(outcome.cycles), "cycle")
    record = SiteRecord(
        grid=outcome.grid,
        before=outcome.site.heights,
        after=outcome.after,
        loose_depth=outcome.loose_depth,
        lip_path=outcome.lip_path,
        lip_cycle=outcome.lip_cycle,
        lip_phase=outcome.lip_phase,
        machine_outline=outcome.machine_outline,
        machine_mesh=outcome.machine_mesh,
        machine_position=outcome.machine_position,
        title=f"{outcome.moved_volume:.2f} bank m³ moved in {num_cycles}",
        num_finished_cycles=len(outcome.cycles),
    )
    return [
        draw_cut_fill(record, folder / "cut_fill.png"),
        draw_bucket_path(record, folder / "bucket_path.png"),
        draw_site_3d(record, folder / "site.png"),
    ]


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
