"""Parameters of the viewer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from viewer.server.access import invalid_origins

__all__ = ["ViewerParams"]

_MIN_TOKEN_LENGTH = 8


@dataclass(frozen=True)
class ViewerParams(Parameters):
    """Parameters of `viewer`."""

    address: str = parameter(
        "127.0.0.1",
        "address to listen on; any other than the loopback address lets other computers connect,"
        " and requires a token",
    )
    port: int = parameter(8080, "port to listen on; 0: any that is free", low=0, high=65535)
    token: str = parameter(
        "",
        "token that the page must give, at least 8 characters; empty: none on the loopback address,"
        " elsewhere one is made and printed",
    )
    allowed_origins: tuple[str, ...] = parameter(
        (),
        "origins of pages that may connect, beside the server's own, as https://example.org:8443",
        items=str,
    )
    simulation_namespace: str = parameter(
        "", "namespace of the soil node; by default that of this node"
    )
    frame_rate: float = parameter(
        30.0, "maximum number of frames a second for each client", unit="Hz", low=1.0, high=120.0
    )
    max_clients: int = parameter(16, "maximum number of clients", low=1, high=1000)
    allow_driving: bool = parameter(True, "whether clients may drive machines")
    allow_simulation_control: bool = parameter(
        True, "whether clients may pause, continue, step and reset the simulation"
    )
    allow_recording: bool = parameter(False, "whether clients may start and stop a recording")
    bag_folder: str = parameter(
        "bags", "folder of the bags that clients may open, and of their recordings; empty: none"
    )
    max_bag_players: int = parameter(
        4, "maximum number of clients that are shown a bag", low=0, high=100
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < len(self.token) < _MIN_TOKEN_LENGTH:
            raise ParameterError(
                f"token has {len(self.token)} characters; give at least {_MIN_TOKEN_LENGTH}"
            )
        if wrong := invalid_origins(self.allowed_origins):
            raise ParameterError(
                f"allowed_origins has {wrong[0]!r}; give origins as https://example.org:8443"
            )

    @property
    def bags(self) -> Path | None:
        """Folder of the bags; None without."""
        return Path(self.bag_folder).expanduser() if self.bag_folder else None
