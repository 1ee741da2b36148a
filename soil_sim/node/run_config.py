"""The configuration of a run, as published on `sim/config`."""

from __future__ import annotations

from dataclasses import asdict

from msg_bridge.codec.run_config import RunFacts, SoilKind, to_config_yaml
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_run import SoilRun
from soil_sim.site.site import Site, SiteParams
from soil_sim.soils.params import SoilParams

__all__ = ["run_config"]


def run_config(
    run: SoilRun,
    site: Site,
    node_params: SoilNodeParams,
    site_params: SiteParams,
    soil_params: SoilParams,
) -> str:
    """Return the YAML text with all parameters of a run, its grid, georeference and soils."""
    soil, georeference = run.endpoint.soil, site.georeference
    facts = RunFacts(
        run_id=run.endpoint.exchange.run_id,
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
    return to_config_yaml(facts, sections, kinds)
