"""The soil node of a run in its replay."""

from __future__ import annotations

from collections.abc import Iterable

from earthmoving_sim.replay.errors import ReplayError
from earthmoving_sim.replay.node_parameters import SoilNodeSetup
from earthmoving_sim.replay.recorded.soil_tick_inputs import SoilTickInputs
from msg_bridge.contract.input_files import InputFile
from msg_bridge.contract.messages import Keyframe, Message
from soil_sim.endpoint import SoilEndpoint, SoilTickResult
from soil_sim.node.run_config import find_input_files, run_config
from soil_sim.site.cut_fill import CutFill
from soil_sim.site.site import make_site
from soil_sim.soil import Soil

__all__ = ["ReplayedSoil"]


class ReplayedSoil:
    """The soil and its end of the exchange.

    Attributes:
        setup: parameters of the node.
        site: initial terrain.
        soil: the terrain.
    """

    def __init__(self, setup: SoilNodeSetup, run_id: int) -> None:
        """
        Args:
            setup: parameters of the node.
            run_id: number of the run.

        Raises:
            EarthmovingError: site or soils are invalid.
        """
        self.setup = setup
        self.site = make_site(setup.site)
        self.soil: Soil = self.site.make_soil(setup.soil)
        self.endpoint = SoilEndpoint(
            self.soil,
            expected=setup.node.expected_machines,
            admit_others=setup.node.admit_other_machines,
            max_tool_displacement=setup.node.max_tool_speed * setup.node.tick_period,
            run_id=run_id,
        )

    def change(self, setup: SoilNodeSetup) -> None:
        """Continue with other parameters on the same site.

        Raises:
            EarthmovingError: invalid soils, or others than `Soil.continue_from` can take.
        """
        soil: Soil = self.site.make_soil(setup.soil)
        soil.continue_from(self.soil)
        self.setup = setup
        self.soil = self.endpoint.soil = soil

    @property
    def input_files(self) -> tuple[InputFile, ...]:
        """The files that the soil has read."""
        return find_input_files(self.setup.site, self.setup.soil)

    def config(self) -> str:
        """Return the configuration of the soil node [YAML]."""
        setup = self.setup
        params = (setup.node, setup.site, setup.soil)
        return run_config(self.endpoint, self.site, *params, self.input_files)

    @property
    def cut_fill(self) -> CutFill | None:
        """Difference of the terrain from the design; None without one."""
        return self.site.cut_fill(self.soil.columns.height)

    def step(
        self, inputs: SoilTickInputs, messages: Iterable[Message], *, release: bool
    ) -> SoilTickResult:
        """Compute the next tick.

        Args:
            inputs: which machines take part.
            messages: what they have sent.
            release: whether absent soil is released.

        Raises:
            ExchangeError: a message violates the protocol.
            ReplayError: an expected machine has not joined.
        """
        for session in inputs.dropped:
            self.endpoint.exchange.drop(session.machine_id)
        if release:
            self.endpoint.release_absent_soil()
        for message in messages:
            self.endpoint.receive(message)
        done = self.endpoint.advance(wait=False)
        if done is None:
            raise ReplayError("the recorded run began without a machine that it expects")
        return done

    def keyframe(self) -> Keyframe:
        """Return a copy of the present terrain."""
        soil = self.soil
        surface = (soil.grid, soil.columns.height.copy(), *soil.layers)
        return Keyframe(self.endpoint.exchange.run_id, soil.revision, *surface)
