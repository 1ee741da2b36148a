"""Controller on plain Cyclone DDS that uses the topics and their types, and no code of the package.

    python cyclone_peer.py DOMAIN

Reads the topics of soil and machine, moves the boom by two kinds of command, sends an invalid
command, and prints a line `REPORT {...}` with everything it observed as JSON. Then it waits for
SIGINT and ends with exit code 0. After a timeout it prints what was received and ends with 1.

It imports only the standard library and cyclonedds. The types below are written from the message
definitions of ROS 2, as any DDS program can write them.
"""

import json
import math
import signal
import struct
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import byte, float64, int32, int64, sequence, uint8, uint32
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

TIMEOUT = 30.0  # of each wait [s]
COMMAND_PERIOD = 0.05  # [s]
POLL_PERIOD = 0.002  # of the readers [s]
SPEED = 0.2  # commanded velocity of the boom [rad/s]
TRAVEL = 0.1  # of the boom for each kind of command [rad]

# Unicast on the loopback interface only: no other DDS program receives anything.
CONFIG = """
<CycloneDDS><Domain>
  <General>
    <Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>
    <AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>40</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers>
  </Discovery>
</Domain></CycloneDDS>
"""


def message(package, kind, /, **fields):
    """Return a ROS message type with its name on the wire."""
    return make_idl_struct(kind, f"{package}::msg::dds_::{kind}_", fields)


Time = message("builtin_interfaces", "Time", sec=int32, nanosec=uint32)
Clock = message("rosgraph_msgs", "Clock", clock=Time)
Header = message("std_msgs", "Header", stamp=Time, frame_id=str)
numbers = sequence[float64]
joint_values = {"name": sequence[str], "position": numbers, "velocity": numbers, "effort": numbers}
JointState = message("sensor_msgs", "JointState", header=Header, **joint_values)
field = {"name": str, "offset": uint32, "datatype": uint8, "count": uint32}
PointField = message("sensor_msgs", "PointField", **field)
PointCloud2 = message(
    "sensor_msgs",
    "PointCloud2",
    header=Header,
    height=uint32,
    width=uint32,
    fields=sequence[PointField],
    is_bigendian=bool,
    point_step=uint32,
    row_step=uint32,
    data=sequence[uint8],
    is_dense=bool,
)
Dimension = message("std_msgs", "MultiArrayDimension", label=str, size=uint32, stride=uint32)
Layout = message("std_msgs", "MultiArrayLayout", dim=sequence[Dimension], data_offset=uint32)
Float64MultiArray = message("std_msgs", "Float64MultiArray", layout=Layout, data=numbers)
Int64MultiArray = message("std_msgs", "Int64MultiArray", layout=Layout, data=sequence[int64])
KeyValue = message("diagnostic_msgs", "KeyValue", key=str, value=str)
texts = {"name": str, "message": str, "hardware_id": str}
DiagnosticStatus = message(
    "diagnostic_msgs", "DiagnosticStatus", level=byte, **texts, values=sequence[KeyValue]
)
DiagnosticArray = message(
    "diagnostic_msgs", "DiagnosticArray", header=Header, status=sequence[DiagnosticStatus]
)

# Quality of service, as a ROS subscriber would ask for it.
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(256))
BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
TRANSIENT_LOCAL = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
)

# Format character of `struct` for each PointField.datatype.
FORMATS = {2: "B", 4: "H", 6: "I", 7: "f", 8: "d"}

MACHINE = "excavator"
FRONT = f"{MACHINE}/front_velocity_controller/commands"
JOINTS = f"{MACHINE}/joint_commands"
READ = {
    "clock": (Clock, BEST_EFFORT),
    f"{MACHINE}/joint_states": (JointState, RELIABLE),
    f"{MACHINE}/applied_commands": (JointState, RELIABLE),
    "terrain/map": (PointCloud2, TRANSIENT_LOCAL),
    "soil/ledger": (Int64MultiArray, RELIABLE),
    "diagnostics": (DiagnosticArray, RELIABLE),
}


class WaitTimeoutError(Exception):
    """A condition was not met within `TIMEOUT`."""


class Peer:
    """Readers, writers, and all received messages.

    Attributes:
        received: messages by topic, oldest first.
        report: content of the REPORT line.
    """

    def __init__(self, domain):
        self._domain = Domain(domain, CONFIG)
        participant = DomainParticipant(domain)

        def topic(name, kind):
            return Topic(participant, f"rt/{name}", kind)  # rt: a ROS topic

        self._readers = {
            name: DataReader(participant, topic(name, kind), qos)
            for name, (kind, qos) in READ.items()
        }
        self._front = DataWriter(participant, topic(FRONT, Float64MultiArray), RELIABLE)
        self._joints = DataWriter(participant, topic(JOINTS, JointState), RELIABLE)
        self.received = {name: [] for name in READ}
        self.report = {}

    def wait(self, what, condition, act=lambda: None):
        """Read messages until a condition holds, and call `act` at 20 Hz.

        Raises:
            WaitTimeoutError: the condition was not met in time.
        """
        deadline = time.monotonic() + TIMEOUT
        due = 0.0
        while not condition():
            now = time.monotonic()
            if now > deadline:
                raise WaitTimeoutError(what)
            if now >= due:
                act()
                due = now + COMMAND_PERIOD
            for name, reader in self._readers.items():
                taken = reader.take(256)
                self.received[name] += [
                    each for each in taken if not isinstance(each, InvalidSample)
                ]
            time.sleep(POLL_PERIOD)

    def front(self, *velocities):
        """Publish velocities of all joints: swing, boom, arm, bucket [rad/s]."""
        self._front.write(Float64MultiArray(Layout([], 0), list(velocities)))

    def joints(self, **velocities):
        """Publish velocities of some joints [rad/s]."""
        names, values = list(velocities), list(velocities.values())
        self._joints.write(JointState(Header(Time(0, 0), ""), names, [], values, []))

    def last(self, topic):
        return self.received[topic][-1]

    # Stages, in order.

    def read_topics(self):
        """Receive messages on every topic, with the map that was published before."""
        num_required = {"clock": 10, "soil/ledger": 10, f"{MACHINE}/joint_states": 5}
        for name in self.received:
            count = num_required.get(name, 1)
            self.wait(
                f"{count} messages on {name}", lambda n=name, k=count: len(self.received[n]) >= k
            )
        self.report["map"] = read_map(self.last("terrain/map"))
        clock = [each.clock for each in self.received["clock"]]
        self.report["clock"] = [each.sec + 1e-9 * each.nanosec for each in clock]
        state = self.last(f"{MACHINE}/joint_states")
        self.report["joint_states"] = {
            "names": state.name,
            "sizes": [len(state.position), len(state.velocity), len(state.effort)],
        }

    def move_boom(self, name, speed, act):
        """Command the boom until it has moved `TRAVEL` and has the commanded velocity."""
        states, applied = f"{MACHINE}/joint_states", f"{MACHINE}/applied_commands"
        initial, first = joints_of(self.last(states)), len(self.received[applied])

        def reached():
            travel = joints_of(self.last(states))["boom"] - initial["boom"]
            velocity = joints_of(self.last(states), "velocity")["boom"]
            return travel / speed >= TRAVEL / abs(speed) and abs(velocity / speed - 1.0) < 0.02

        self.wait(f"the boom to move {TRAVEL} rad at {speed} rad/s by {name}", reached, act)
        end = joints_of(self.last(states))
        self.report[name] = {
            "moved": {joint: end[joint] - initial[joint] for joint in initial},
            "speed": joints_of(self.last(states), "velocity")["boom"],
            "applied_names": self.last(applied).name,
            "applied": distinct(each.velocity for each in self.received[applied][first:]),
        }

    def send_invalid_command(self):
        """Send NaN, and receive the diagnostics of the rejection."""
        applied = f"{MACHINE}/applied_commands"
        first, key = len(self.received[applied]), "rejected front_velocity_controller/commands"

        def rejection():
            for array in self.received["diagnostics"]:
                for status in array.status:
                    values = {each.key: each.value for each in status.values}
                    if key in values:
                        found = {"name": status.name, "level": status.level}
                        return {**found, "message": status.message, "values": values}
            return None

        self.report["rejection_before"] = rejection()
        self.wait("the rejection", rejection, lambda: self.front(0.3, math.nan, 0.3, 0.3))
        self.report["rejection"] = rejection()
        after = self.received[applied][first:]
        self.report["applied_after_nan"] = distinct(each.velocity for each in after)

    def finish(self):
        """Report what held in all received messages."""
        ledgers = [
            dict(zip(each.layout.dim[0].label.split(","), each.data, strict=True))
            for each in self.received["soil/ledger"]
        ]
        self.report["ledger"] = ledgers[-1]
        self.report["imbalances"] = sorted({each["imbalance"] for each in ledgers})
        self.report["ledger_ticks"] = [each["tick"] for each in ledgers[:10]]
        states = self.received[f"{MACHINE}/joint_states"]
        self.report["finite"] = all(math.isfinite(x) for each in states for x in each.position)
        self.report["modules"] = sorted({name.partition(".")[0] for name in sys.modules})


def joints_of(state, of="position"):
    return dict(zip(state.name, getattr(state, of), strict=True))


def distinct(lists):
    """Return lists without repetitions, in order; NaN and infinity, which JSON lacks, as text."""
    plain = [[x if math.isfinite(x) else str(x) for x in each] for each in lists]
    return [each for i, each in enumerate(plain) if each not in plain[:i]]


def read_map(cloud):
    """Return an organised cloud, decoded by its own description of the fields."""
    fields = {each.name: (each.offset, FORMATS[each.datatype]) for each in cloud.fields}
    order = ">" if cloud.is_bigendian else "<"
    data = bytes(cloud.data)

    def value(field, row, col):
        offset, kind = fields[field]
        start = row * cloud.row_step + col * cloud.point_step + offset
        return struct.unpack_from(order + kind, data, start)[0]

    cells = [(row, col) for row in range(cloud.height) for col in range(cloud.width)]
    return {
        "stamp": [cloud.header.stamp.sec, cloud.header.stamp.nanosec],
        "frame_id": cloud.header.frame_id,
        "shape": [cloud.height, cloud.width],
        "fields": [[each.name, each.offset, each.datatype, each.count] for each in cloud.fields],
        "bytes": [cloud.point_step, cloud.row_step, len(data)],
        # Row, column and position of every 97th cell: a short sample from the whole map.
        "sample": [[*cell, *(value(field, *cell) for field in "xyz")] for cell in cells[::97]],
        "mm3": sum(int(value("volume_mm3", *cell)) for cell in cells),
    }


def main():
    peer = Peer(int(sys.argv[1]))
    try:
        peer.read_topics()
        peer.move_boom("front", SPEED, lambda: peer.front(0.0, SPEED, 0.0, 0.0))
        peer.move_boom("joints", -SPEED, lambda: peer.joints(boom=-SPEED))
        peer.send_invalid_command()
        peer.finish()
    except WaitTimeoutError as error:
        counts = {name: len(messages) for name, messages in peer.received.items()}
        print(f"{TIMEOUT:g} s passed while waiting for {error}; received {counts},\n{peer.report}")
        return 1
    print("REPORT", json.dumps(peer.report), flush=True)
    signal.sigwait({signal.SIGINT})
    return 0


if __name__ == "__main__":
    # Blocked before DDS starts its threads, so that none of them handles SIGINT.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    sys.exit(main())
