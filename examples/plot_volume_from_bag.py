"""Plot the payload of each machine and the volume of soil in motion from a recording.

    python examples/plot_volume_from_bag.py bags/demo-2026-01-31T12-00-00Z

The picture is `out/volume.png`, or the file that the second argument names.

The arrays in these topics are labelled: the label of their dimension names the values.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from msg_bridge.bag.reader import BagReader

LEDGER, PAYLOAD, PAYLOAD_TYPE = "/soil/ledger", "/payload", "std_msgs/msg/Float64MultiArray"


def values(msg: Any) -> dict[str, float]:
    """Return the values of a labelled array by name."""
    return dict(zip(msg.layout.dim[0].label.split(","), msg.data, strict=True))


def plot(bag: Path, picture: Path) -> None:
    """Plot a recording, and print the worst imbalance of its ledger."""
    reader = BagReader(bag)
    payloads = [
        topic
        for topic, info in reader.topics.items()
        if topic.endswith(PAYLOAD) and info.type == PAYLOAD_TYPE
    ]
    if not payloads:
        raise ValueError(f"{bag} has no payload of a machine, that is no topic <machine>{PAYLOAD}")
    rows: dict[str, list[dict[str, float]]] = {topic: [] for topic in (LEDGER, *payloads)}
    for topic, _, msg in reader.messages(rows):
        rows[topic].append(values(msg))
    ledger = rows[LEDGER]
    if not ledger:
        raise ValueError(f"{bag} has no message on {LEDGER}")

    figure = Figure(figsize=(8, 6), layout="constrained")
    top, bottom = figure.subplots(2)
    for topic in payloads:
        payload = rows[topic]
        name = topic.removesuffix(PAYLOAD)
        top.plot(
            [row["time_s"] for row in payload], [row["bank_m3"] for row in payload], label=name
        )
    top.set(xlabel="simulation time [s]", ylabel="payload [bank m³]")
    top.legend()
    for name in ("particles", "pending", "in_flight"):
        bottom.plot(
            [row["tick"] for row in ledger], [1e-9 * row[name] for row in ledger], label=name
        )
    bottom.set(xlabel="tick", ylabel="soil in motion [bank m³]")
    bottom.legend()
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture)
    imbalance = max(abs(row["imbalance"]) for row in ledger)
    machines = ", ".join(topic.removesuffix(PAYLOAD) for topic in payloads)
    print(f"{picture}: {machines}; {len(ledger)} ticks, imbalance {imbalance:.0f} mm3 at worst")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("bag", type=Path, help="folder of the recording")
    parser.add_argument(
        "picture",
        nargs="?",
        type=Path,
        default=Path("out/volume.png"),
        help="file to write (out/volume.png)",
    )
    options = parser.parse_args()
    try:
        plot(options.bag, options.picture)
    except (OSError, ValueError) as error:  # no such bag or topic; a picture of another format
        sys.exit(f"{parser.prog}: {error}")


if __name__ == "__main__":
    main()
