"""TwoHosts: two network namespaces that are connected as two computers on one cable."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence

__all__ = ["NamespaceError", "TwoHosts"]


class NamespaceError(Exception):
    """Network namespaces cannot be made here."""


class TwoHosts:
    """Two network namespaces with a veth pair, removed by `close`.

    Attributes:
        names: names of the namespaces.
        is_lossy: whether the cable loses and delays packets.
    """

    def __init__(self, *, loss_percent: float, delay_ms: float) -> None:
        """
        Args:
            loss_percent, delay_ms: of the packets in each direction, where the kernel can do so.

        Raises:
            NamespaceError: not permitted here, or a program is missing.
        """
        if shutil.which("ip") is None:
            raise NamespaceError("the program ip is missing; install iproute2")
        self.names = [f"em{os.getpid()}{side}" for side in "ab"]
        self.is_lossy = True
        try:
            self._connect(loss_percent, delay_ms)
        except NamespaceError:
            self.close()
            raise

    def command(self, host: int, words: Sequence[str | os.PathLike[str]]) -> list[str]:
        """Return a command that runs on a host."""
        return ["ip", "netns", "exec", self.names[host], *map(os.fspath, words)]

    def close(self) -> None:
        """Remove the namespaces."""
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)

    def _connect(self, loss_percent: float, delay_ms: float) -> None:
        cables = [f"{name}v" for name in self.names]
        for name in self.names:
            _ip("netns", "add", name)
        _ip("link", "add", cables[0], "type", "veth", "peer", "name", cables[1])
        for k, (name, cable) in enumerate(zip(self.names, cables, strict=True)):
            _ip("link", "set", cable, "netns", name)
            _ip("-n", name, "address", "add", f"10.77.0.{k + 1}/24", "dev", cable)
            for device in ("lo", cable):
                _ip("-n", name, "link", "set", device, "up")
            _ip("-n", name, "route", "add", "224.0.0.0/4", "dev", cable)  # discovery
            netem = ["netem", "loss", f"{loss_percent}%", "delay", f"{delay_ms}ms"]
            command = self.command(k, ["tc", "qdisc", "add", "dev", cable, "root", *netem])
            done = subprocess.run(command, capture_output=True, check=False)
            self.is_lossy &= done.returncode == 0


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NamespaceError(f"ip {' '.join(words)}: {done.stderr.strip()}")
