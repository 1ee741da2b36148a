"""Compare recordings: volumes, cycles and work of the joints, with DuckDB.

    python examples/analyse_bags.py bags/format_1 bags/format_2

Exports the topics that it needs as Parquet tables, into the folder `--tables` or a temporary one,
and queries those of all bags at once; tables of the same bags that are there already are replaced.
`pip install duckdb` installs what this needs beside the package.
"""

import argparse
import sys
import tempfile
from pathlib import Path

TOPICS = ("/soil/conversions", "/operator/cycles", "/joint_states")
VOLUMES = """
    SELECT bag,
           sum(volume_mm3) FILTER (kind = 0) / 1e9 AS "excavated [m3]",
           sum(volume_mm3) FILTER (kind = 1) / 1e9 AS "deposited [m3]",
           coalesce(sum(volume_mm3) FILTER (kind = 2), 0) / 1e9 AS "outside [m3]"
    FROM read_parquet('{tables}/*/**/soil/conversions.parquet', hive_partitioning = true)
    GROUP BY bag ORDER BY bag
"""
# Machines have one namespace or several; the operators of excavators and trucks report other keys.
CYCLES = """
    SELECT bag, regexp_extract(filename, 'bag=[^/]*/(.*)/operator/', 1) AS machine,
           count(*) AS cycles,
           median(duration) AS "cycle time [s]",
           sum(moved_volume) AS "moved [m3]",
           3600 * sum(moved_volume) / sum(duration) AS "moved in the cycles [m3/h]"
    FROM read_parquet('{tables}/*/**/operator/cycles.parquet', hive_partitioning = true,
                      filename = true, union_by_name = true)
    GROUP BY bag, machine ORDER BY bag, machine
"""
# Power of a joint is torque times angular velocity; a sum over time steps is its work.
WORK = """
    WITH steps AS (
        SELECT bag, regexp_extract(filename, 'bag=[^/]*/(.*)/joint_states', 1) AS machine,
               joint, effort * velocity AS power,
               epoch_ns(stamp) - lag(epoch_ns(stamp))
                   OVER (PARTITION BY bag, filename, joint ORDER BY stamp) AS step
        FROM read_parquet('{tables}/*/**/joint_states.parquet', hive_partitioning = true,
                          filename = true)
        WHERE joint IN ('swing', 'boom', 'arm', 'bucket')
    )
    SELECT bag, machine, joint, sum(greatest(power, 0) * step) / 1e12 AS "work [kJ]"
    FROM steps GROUP BY bag, machine, joint ORDER BY bag, machine, joint
"""


def analyse(bags: list[Path], tables: Path) -> None:
    """Export bags into a folder of tables, and print the results of the queries."""
    import duckdb

    from earthmoving_sim.bag_export import export_bag
    from msg_bridge.bag.bag_files import bag_name
    from msg_bridge.bag.reader import BagReader

    for bag in bags:
        folder = tables / f"bag={bag_name(bag)}"
        export_bag(
            BagReader(bag), folder, is_selected=lambda name: name.endswith(TOPICS), overwrite=True
        )
    for query in (VOLUMES, CYCLES, WORK):
        print(duckdb.sql(query.format(tables=tables)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("bags", nargs="+", type=Path, help="recordings")
    parser.add_argument("--tables", type=Path, help="folder to keep the tables in")
    options = parser.parse_args()

    import duckdb

    from msg_bridge.contract.errors import EarthmovingError

    with tempfile.TemporaryDirectory() as temporary:
        try:
            analyse(options.bags, options.tables or Path(temporary))
        except (EarthmovingError, duckdb.Error) as error:  # no such bag; no such table
            sys.exit(f"{parser.prog}: {error}")


if __name__ == "__main__":
    main()
