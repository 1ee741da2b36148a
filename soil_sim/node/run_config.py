"""The configuration of a run, as published on `sim/config`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from msg_bridge.codec.run_config import RunFacts, SoilKind, to_config_yaml
from msg_bridge.config_files import find_config
from msg_bridge.contract.input_files import InputFile, read_input_file
from soil_sim.endpoint import SoilEndpoint
from soil_sim.node.params import SoilNodeParams
from soil_sim.site.site import Site, SiteParams
from soil_sim.soils.params import SoilParams

__all__ = ["find_input_files", "run_config"]


def find_input_files(site: SiteParams, soil: SoilParams) -> tuple[InputFile, ...]:
    """Return the files that site and soils were read from.

    Raises:
        ConfigError: there is no file of soils.
        OSError: a file cannot be read.
    """
    files = [read_input_file(f"site.{name}", path) for name, path in site.files.items()]
    if soil.is_named:
        files.append(read_input_file("soil.soils", find_config(soil.soils)))
    return tuple(files)


def run_config(
    endpoint: SoilEndpoint,
    site: Site,
    node_params: SoilNodeParams,
    site_params: SiteParams,
    soil_params: SoilParams,
    input_files: Sequence[InputFile] = (),
) -> str:
    """Return the YAML text with all parameters of a run, its grid, georeference and soils."""
    soil, georeference = endpoint.soil, site.georeference
    facts = RunFacts(
        run_id=endpoint.exchange.run_id,
        tick_period=node_params.tick_period,
        realtime=node_params.sync == "realtime",
        cell=soil.grid.cell,
        soils=soil.loose_soils,
    )
    sections = {
        "grid": {"rows": soil.grid.rows, "cols": soil.grid.cols, "floor": soil.columns.floor},
        "georeference": None if georeference is None else str(georeference),
        "soil_sim": asdict(node_params),
        "site": asdict(site_params),
        "soil": asdict(soil_params),
    }
    names = (soil_params.soil, *soil_params.additional_soils)
    kinds = [
        SoilKind(
            name=name,
            colour=(kind.colour[0], kind.colour[1], kind.colour[2]),
            swell=kind.swell,
            density=kind.density,
            repose_angles=(kind.repose_angle, kind.repose_angle_damp, kind.repose_angle_wet),
        )
        for name, kind in zip(names, soil.soil_types, strict=True)
    ]
    return to_config_yaml(facts, sections, kinds, input_files)
