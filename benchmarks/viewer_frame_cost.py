"""Measure the live page: cost and size of a frame, and the time from a key to the motion.

    python -m benchmarks.viewer_frame_cost             # without nodes
    python -m benchmarks.viewer_frame_cost --latency   # also with soil, machine and viewer

A frame has a map of 257 x 257 cells of which a digging excavator changes some, 10,000 particles
that all move, and two machines. The cost is the median CPU time of the thread of the server; the
lock of the scene is held meanwhile. The latency is the wall time from sending a `drive` message
over the WebSocket until `joint_states` with a moving joint arrives, at a machine in real time; a
tick has 10 ms and `state_rate` is 50 Hz.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from benchmarks.result_table import Column, ResultTable, describe_load, make_parser
from earthmoving_sim.multi_process.node_process import NodeProcess, stop_all
from machine_sim.machine import load_machine_spec
from machine_sim.machine.description import description_text
from msg_bridge.codec import qos
from msg_bridge.codec.particles import PARTICLE
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import RowChunk, Stream
from msg_bridge.contract.rows import MAP_UPDATE, Rows
from msg_bridge.dds_profile import keep_discovery_on_this_host, use_shipped_profile
from viewer.scene.scene import Scene
from viewer.scene.terrain_surface import SurfaceMap
from viewer.scene.terrain_tiles import SurfaceLayers
from viewer.scene.urdf import parse_urdf
from viewer.server.encoding import SceneEncoder
from viewer.server.frames import FrameStream

GRID = Grid(257, 257, 0.2)
NUM_PARTICLES = 10_000
TICKS_PER_FRAME = 3
CELLS_PER_TICK = 150
"""Number of changed cells in a tick of digging with slope failure around the bucket."""
NUM_PRESSES = 60
PORT = 18431
MOVING = 0.01
"""Joint velocity above which a joint counts as moving [rad/s]."""

COLUMNS = (
    *(Column("receive"), Column("first client"), Column("another client")),
    *(Column("95 %"), Column("size", "kB", ".1f")),
)


class DiggingScene:
    """A scene that changes from frame to frame."""

    def __init__(self, num_particles: int) -> None:
        self.scene = Scene()
        self._rng = np.random.default_rng(1)
        shape = GRID.shape
        height = self._rng.random(shape).astype(np.float32)
        layers = SurfaceLayers(height, np.zeros(shape), np.zeros(shape), np.zeros(shape))
        self.scene.start_run(1)
        self.scene.terrain.receive_map(SurfaceMap(1, 0, GRID, layers))
        model = parse_urdf(
            description_text(load_machine_spec(find_config("machines/excavator.yaml")))
        )
        for name in ("/digger", "/truck"):
            view = self.scene.machine(name)
            view.model, view.model_version = model, 1
        self._particles: Rows = np.zeros(num_particles, dtype=PARTICLE)
        for axis in ("x", "y", "z"):
            self._particles[axis] = self._rng.normal(0.0, 3.0, num_particles)
        self._particles["diameter"], self._particles["id"] = 0.2, np.arange(num_particles)
        self._revision, self._seq = 0, 1

    def change(self) -> float:
        """Receive the messages of one frame; return the CPU time [s]."""
        chunks = [self._rows() for _ in range(TICKS_PER_FRAME)]
        particles = self._particles.copy()
        particles["z"] += 0.001 * self._rng.random(particles.size).astype(np.float32)
        start = time.thread_time()
        with self.scene.lock:
            for chunk in chunks:
                self.scene.terrain.receive_updates(chunk)
            self.scene.terrain_changed()
            self.scene.set_particles("/digger", particles)
            for view in self.scene.machines.values():
                names = list(view.model.joint_index) if view.model else []
                zeros = [0.0] * len(names)
                view.set_joints(0.0, names, self._rng.random(len(names)).tolist(), zeros, zeros)
            self.scene.machines_changed()
        return time.thread_time() - start

    def _rows(self) -> RowChunk:
        """Return the rows of a tick: cells around a place that moves along a trench."""
        self._revision += 1
        center = 60 + (self._revision // 20) % 100
        rows = np.zeros(CELLS_PER_TICK, dtype=MAP_UPDATE)
        rows["row"] = np.clip(self._rng.normal(center, 5.0, CELLS_PER_TICK), 0, GRID.rows - 1)
        rows["col"] = np.clip(self._rng.normal(128, 5.0, CELLS_PER_TICK), 0, GRID.cols - 1)
        rows["z"], rows["revision"] = self._rng.random(CELLS_PER_TICK), self._revision
        rows["seq"] = np.arange(self._seq, self._seq + CELLS_PER_TICK)
        self._seq += CELLS_PER_TICK
        return RowChunk(1, Stream.MAP_UPDATE, 0, 0, rows)


def measure_frames(num_particles: int, num_frames: int) -> list[float]:
    """Return the values of `COLUMNS`."""
    digging = DiggingScene(num_particles)
    encoder = SceneEncoder(digging.scene)
    clients = (FrameStream(encoder), FrameStream(encoder))
    times: tuple[list[float], list[float], list[float]] = ([], [], [])
    sizes: list[int] = []
    for number in range(num_frames):
        received = digging.change()
        for client, own in zip(clients, times[1:], strict=True):
            start = time.thread_time()
            messages = client.next_messages()
            elapsed = time.thread_time() - start
            client.acknowledge(client.seq)
            if number >= 20:  # the first frames bring the whole map
                own.append(1e3 * elapsed)
                sizes.append(sum(map(len, messages)))
        times[0].append(1e3 * received)
    return [*map(statistics.median, times), _percentile(times[1]), max(sizes) / 1e3]


def _percentile(values: list[float]) -> float:
    """Return the value that 95 % of some values do not exceed."""
    return sorted(values)[int(0.95 * len(values))]


def measure_latency(folder: Path) -> list[float]:
    """Return the times from a `drive` message to a moving joint [ms]."""
    os.environ["ROS_DOMAIN_ID"] = str(random.SystemRandom().randrange(102, 220))
    keep_discovery_on_this_host()
    use_shipped_profile()
    modules = {
        "soil_sim": ("soil_sim.node.soil_node", []),
        "machine_sim": ("machine_sim.node.machine_node", []),
        "viewer": ("viewer.node", ["--ros-args", "-p", f"port:={PORT}"]),
    }
    started = [
        NodeProcess(name, module, arguments, folder / f"{name}.log")
        for name, (module, arguments) in modules.items()
    ]
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        return asyncio.run(_press_keys())
    finally:
        rclpy.try_shutdown()
        stop_all(started[::-1], 20.0)


async def _press_keys() -> list[float]:
    """Press and release keys, and measure until the boom moves [ms]."""
    node = Node("viewer_latency")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    newest: dict[str, float] = {"boom": 0.0, "time": 0.0}

    def on_joints(msg: JointState) -> None:
        newest["boom"] = msg.velocity[list(msg.name).index("boom")]
        newest["time"] = time.perf_counter()

    node.create_subscription(JointState, "/excavator/joint_states", on_joints, qos.STATE)
    stopped = asyncio.Event()

    async def spin() -> None:
        while not stopped.is_set():
            await asyncio.to_thread(executor.spin_once, timeout_sec=0.01)

    spinning = asyncio.create_task(spin())
    async with aiohttp.ClientSession() as session:
        socket = await _connect(session)
        await socket.send_json({"type": "login", "token": "", "protocol": 1, "source": "live"})
        while newest["time"] == 0.0:
            await asyncio.sleep(0.1)
        await asyncio.sleep(3.0)
        await socket.send_json({"type": "take_control", "machine": "/excavator"})
        latencies = []
        for number in range(NUM_PRESSES):
            key = "k" if number % 2 == 0 else "i"
            while abs(newest["boom"]) > 0.5 * MOVING:
                await asyncio.sleep(0.005)
            await asyncio.sleep(0.1 + 0.02 * random.random())
            start = time.perf_counter()
            while abs(newest["boom"]) < MOVING:
                await socket.send_json(_drive([key]))
                for _ in range(50):
                    if abs(newest["boom"]) >= MOVING:
                        break
                    await asyncio.sleep(0.001)
            latencies.append(1e3 * (newest["time"] - start))
            await socket.send_json(_drive([]))
        await socket.close()
    stopped.set()
    await spinning
    executor.shutdown()
    node.destroy_node()
    return latencies


async def _connect(session: aiohttp.ClientSession) -> aiohttp.ClientWebSocketResponse:
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        with contextlib.suppress(aiohttp.ClientConnectorError):
            return await session.ws_connect(f"http://127.0.0.1:{PORT}/stream", max_msg_size=0)
        await asyncio.sleep(0.1)
    raise TimeoutError("the viewer does not listen")


def _drive(held: list[str]) -> dict[str, Any]:
    return {"type": "drive", "machine": "/excavator", "held": held, "deflections": {}}


def main() -> None:
    """Measure and print."""
    parser = make_parser(__doc__)
    parser.add_argument("--frames", type=int, default=600, help="number of frames (default: 600)")
    parser.add_argument("--latency", action="store_true", help="also measure with nodes")
    options = parser.parse_args()
    table = ResultTable(COLUMNS, as_json=options.json)
    table.print_note(describe_load())
    table.print_header("ms, kB")
    for count in (0, NUM_PARTICLES):
        table.print_row(f"{count} particles", measure_frames(count, options.frames))
    if not options.latency:
        return
    with tempfile.TemporaryDirectory() as folder:
        latencies = measure_latency(Path(folder))
    latency_table = ResultTable((Column("median"), Column("95 %")), as_json=options.json)
    latency_table.print_header("ms")
    latency_table.print_row("key to motion", [statistics.median(latencies), _percentile(latencies)])


if __name__ == "__main__":
    main()
