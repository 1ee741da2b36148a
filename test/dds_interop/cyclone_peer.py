"""A controller on plain Cyclone DDS: it knows the topics and their types, and nothing of ours.

    python cyclone_peer.py DOMAIN

It reads what the soil and the machine tell, moves the boom by two kinds of command, sends one that
must be refused, and writes a line `REPORT {...}` of what it saw as JSON. Then it waits for SIGINT
and ends with 0. If what it waits for does not come, it writes what it has and ends with 1.

It must import nothing but the standard library and cyclonedds: the types below are written from
the message definitions of ROS 2, and stand for any DDS program that knows these.
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

DEADLINE = 30.0  # s for each thing waited for
PERIOD = 0.05  # s between two commands
TURN = 0.002  # s between two looks at the readers
SPEED = 0.2  # rad/s the boom is told
TRAVEL = 0.1  # rad it shall go

# On the loopback interface, each participant asked by its own port: nobody else is disturbed.
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
    """A ROS message type, by its name on the wire."""
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

# PointField.datatype: how struct calls it.
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


class NotSeenError(Exception):
    """What is waited for did not come."""


class Peer:
    """Readers and writers, and all that has been read.

    Attributes:
        seen: messages by topic, oldest first.
        report: what is told in the end.
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
        self.seen = {name: [] for name in READ}
        self.report = {}

    def wait(self, what, condition, act=lambda: None):
        """Read until a condition holds, and act at 20 Hz meanwhile.

        Raises:
            NotSeenError: it did not come to hold in time.
        """
        deadline = time.monotonic() + DEADLINE
        due = 0.0
        while not condition():
            now = time.monotonic()
            if now > deadline:
                raise NotSeenError(what)
            if now >= due:
                act()
                due = now + PERIOD
            for name, reader in self._readers.items():
                taken = reader.take(256)
                self.seen[name] += [each for each in taken if not isinstance(each, InvalidSample)]
            time.sleep(TURN)

    def front(self, *velocities):
        """Command all joints: swing, boom, arm, bucket [rad/s]."""
        self._front.write(Float64MultiArray(Layout([], 0), list(velocities)))

    def joints(self, **velocities):
        """Command some joints [rad/s]."""
        names, values = list(velocities), list(velocities.values())
        self._joints.write(JointState(Header(Time(0, 0), ""), names, [], values, []))

    def last(self, topic):
        return self.seen[topic][-1]

    # What it does, in order.

    def listen(self):
        """Everything that is told is received, the map too, which was published before."""
        enough = {"clock": 10, "soil/ledger": 10, f"{MACHINE}/joint_states": 5}
        for name in self.seen:
            needed = enough.get(name, 1)
            self.wait(f"{needed} on {name}", lambda n=name, k=needed: len(self.seen[n]) >= k)
        self.report["map"] = read_map(self.last("terrain/map"))
        clock = [each.clock for each in self.seen["clock"]]
        self.report["clock"] = [each.sec + 1e-9 * each.nanosec for each in clock]
        state = self.last(f"{MACHINE}/joint_states")
        self.report["joint_states"] = {
            "names": state.name,
            "sizes": [len(state.position), len(state.velocity), len(state.effort)],
        }

    def move(self, name, speed, act):
        """Command the boom until it has gone its way, and goes as fast as told."""
        states, applied = f"{MACHINE}/joint_states", f"{MACHINE}/applied_commands"
        begin, first = joints_of(self.last(states)), len(self.seen[applied])

        def there():
            went = joints_of(self.last(states))["boom"] - begin["boom"]
            goes = joints_of(self.last(states), "velocity")["boom"]
            return went / speed >= TRAVEL / abs(speed) and abs(goes / speed - 1.0) < 0.02

        self.wait(f"the boom to go {TRAVEL} rad at {speed} rad/s by {name}", there, act)
        end = joints_of(self.last(states))
        self.report[name] = {
            "moved": {joint: end[joint] - begin[joint] for joint in begin},
            "speed": joints_of(self.last(states), "velocity")["boom"],
            "applied_names": self.last(applied).name,
            "applied": distinct(each.velocity for each in self.seen[applied][first:]),
        }

    def send_invalid_command(self):
        """Send what is no number, and read that it was refused."""
        applied = f"{MACHINE}/applied_commands"
        first, key = len(self.seen[applied]), "rejected front_velocity_controller/commands"

        def told():
            for array in self.seen["diagnostics"]:
                for status in array.status:
                    values = {each.key: each.value for each in status.values}
                    if key in values:
                        found = {"name": status.name, "level": status.level}
                        return {**found, "message": status.message, "values": values}
            return None

        self.report["refused_before"] = told()
        self.wait("the refusal", told, lambda: self.front(0.3, math.nan, 0.3, 0.3))
        self.report["refusal"] = told()
        after = self.seen[applied][first:]
        self.report["applied_after_nan"] = distinct(each.velocity for each in after)

    def finish(self):
        """What was true all the time."""
        ledgers = [
            dict(zip(each.layout.dim[0].label.split(","), each.data, strict=True))
            for each in self.seen["soil/ledger"]
        ]
        self.report["ledger"] = ledgers[-1]
        self.report["imbalances"] = sorted({each["imbalance"] for each in ledgers})
        self.report["ledger_ticks"] = [each["tick"] for each in ledgers[:10]]
        states = self.seen[f"{MACHINE}/joint_states"]
        self.report["finite"] = all(math.isfinite(x) for each in states for x in each.position)
        self.report["modules"] = sorted({name.partition(".")[0] for name in sys.modules})


def joints_of(state, of="position"):
    return dict(zip(state.name, getattr(state, of), strict=True))


def distinct(lists):
    """Without repeats, in order; what JSON has no word for as text."""
    plain = [[x if math.isfinite(x) else str(x) for x in each] for each in lists]
    return [each for i, each in enumerate(plain) if each not in plain[:i]]


def read_map(cloud):
    """An organised cloud, decoded by what it says of itself."""
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
        # Row, column, position of every 97th cell: all over the map, and a list one can read.
        "some": [[*cell, *(value(field, *cell) for field in "xyz")] for cell in cells[::97]],
        "mm3": sum(int(value("volume_mm3", *cell)) for cell in cells),
    }


def main():
    peer = Peer(int(sys.argv[1]))
    try:
        peer.listen()
        peer.move("front", SPEED, lambda: peer.front(0.0, SPEED, 0.0, 0.0))
        peer.move("joints", -SPEED, lambda: peer.joints(boom=-SPEED))
        peer.send_invalid_command()
        peer.finish()
    except NotSeenError as error:
        counts = {name: len(messages) for name, messages in peer.seen.items()}
        print(
            f"waited {DEADLINE:g} s in vain for {error}; received {counts}\nand saw {peer.report}"
        )
        return 1
    print("REPORT", json.dumps(peer.report), flush=True)
    signal.sigwait({signal.SIGINT})
    return 0


if __name__ == "__main__":
    # Blocked from the start, so that it is there to be waited for, in the threads of DDS too.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    sys.exit(main())
