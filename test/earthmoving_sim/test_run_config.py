"""load_run_config: the demo's parameters and what files and options change of them."""

from pathlib import Path

import pytest
import yaml

from earthmoving_sim import cli
from earthmoving_sim.config_layers import SECTIONS
from earthmoving_sim.multi_process.parameter_file import write_node_parameters
from earthmoving_sim.run_config import load_run_config
from msg_bridge.config_files import ConfigError
from msg_bridge.contract.errors import ParameterError


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a parameter file and returns its path."""

    def write(text: str) -> Path:
        path = tmp_path / "mine.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_defaults_are_those_of_the_shipped_demo():
    config = load_run_config()
    assert config.soil.repose_angle == 35.0
    assert config.soil.swell == 0.15
    assert config.particles.nominal_volume == 1_000_000
    assert config.stepping.tick_period == pytest.approx(0.01)
    assert (config.behaviour.min_radius, config.behaviour.max_radius) == (4.4, 7.3)
    assert config.task.cycles == 5
    assert config.machine.bucket.width == 1.2


def test_file_changes_only_the_parameters_that_it_names(written):
    config = load_run_config(written("behaviour: {dump_radius: 5.5}\nsoil: {swell: 0.2}"))
    assert config.behaviour.dump_radius == 5.5
    assert (config.soil.swell, config.soil.repose_angle) == (0.2, 35.0)
    assert config.particles.nominal_volume == 1_000_000


@pytest.mark.parametrize("text", ["", "# only a comment", "run:", "behaviour: {}"])
def test_empty_file_or_section_changes_nothing(written, text):
    config, default = load_run_config(written(text)), load_run_config()
    assert all(getattr(config, name) == getattr(default, name) for name in SECTIONS)


def test_options_override_the_file(written):
    config = load_run_config(written("task: {cycles: 3}\nrun: {seed: 4}"), {"cycles": 7})
    assert (config.task.cycles, config.run.seed) == (7, 4)


def test_options_are_validated():
    with pytest.raises(ParameterError, match=r"cycles is 0"):
        load_run_config(overrides={"cycles": 0})


@pytest.mark.parametrize("soil", ["loam", "wet clay"])
def test_named_soil_replaces_the_soil_of_the_demo(written, soil):
    for config in (
        load_run_config(soil=soil),
        load_run_config(written(f"soil: {{soil: {soil}}}")),
        load_run_config(written("soil: {repose_angle: 31.0}"), soil=soil),
    ):
        assert config.soil_description == config.soil.soil == soil
        assert config.soil.soil_types()[0].cohesion > 0.0


def test_description_of_a_soil_without_a_name_has_its_angle_and_swell():
    description = load_run_config().soil_description
    assert "35" in description
    assert "0.15" in description


def test_unknown_soil_is_rejected_with_the_known_names():
    with pytest.raises(ParameterError, match=r"'mud'.*dry sand.*loam.*wet clay"):
        load_run_config(soil="mud")


NODES = """
soil_sim:
  ros__parameters:
    sync: realtime
    site: {terrain: rough}
    soil: {swell: 0.2, relaxation_radius: 3.0}
/**/machine_sim:
  ros__parameters:
    machine: machines/reference_2014.yaml
    x: 3.0
    particles.nominal_volume: 2000000
    stepping: {track_model: dynamic}
/excavator/dig_operator:
  ros__parameters: {task: {cycles: 2}, behaviour: {dump_radius: 5.5}}
/exchange_recorder:
  ros__parameters: {path: bags/mine}
"""


def test_file_in_the_format_of_the_nodes_is_read(written):
    config = load_run_config(written(NODES))
    assert (config.soil.swell, config.soil.relaxation_radius) == (0.2, 3.0)
    assert config.soil.repose_angle == 35.0
    assert config.particles.nominal_volume == 2_000_000
    assert config.stepping.track_model == "dynamic"
    assert (config.task.cycles, config.behaviour.dump_radius) == (2, 5.5)
    assert config.machine.name == "reference_2014"
    assert set(config.unused) == {
        "soil_sim.sync",
        "soil_sim.site",
        "machine_sim.x",
        "exchange_recorder",
    }


@pytest.mark.parametrize("name", ["soil_sim.yaml", "machine_sim.yaml", "dig_operator.yaml"])
def test_shipped_parameter_files_of_the_nodes_are_read(name):
    assert load_run_config(name).task.cycles == 5


def test_parameters_written_for_the_nodes_are_read_back(tmp_path):
    config = load_run_config(overrides={"cycles": 2}, soil="loam")
    path = tmp_path / "parameters.yaml"
    write_node_parameters(
        path,
        config,
        site=tmp_path / "site.npz",
        bag=tmp_path / "bag",
        realtime=False,
        command_interval_ticks=2,
        command_delay_ticks=2,
    )
    content = yaml.safe_load(path.read_text())
    del content["/soil_sim"]["ros__parameters"]["soil"]["repose_angle"]
    del content["/soil_sim"]["ros__parameters"]["soil"]["swell"]
    path.write_text(yaml.safe_dump(content))
    again = load_run_config(path)
    for section in SECTIONS:
        assert getattr(again, section) == getattr(config, section), section


def test_machine_file_of_the_user_is_used(written, tmp_path):
    shipped = (Path(__file__).parents[2] / "config/machines/excavator.yaml").read_text()
    own = tmp_path / "narrow.yaml"
    own.write_text(shipped.replace("width: 1.2", "width: 0.9"), encoding="utf-8")
    assert load_run_config(written(f"machine: {own}")).machine.bucket.width == 0.9


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sole: {swell: 0.1}", "unknown section 'sole'.*did you mean 'soil'"),
        ("swel: 0.1", "unknown section 'swel'.*did you mean 'swell' in section soil"),
        ("soil: {swel: 0.1}", "unknown parameter 'swel' in section soil.*did you mean 'swell'"),
        ("soil: {cycles: 3}", "unknown parameter 'cycles'.*did you mean 'cycles' in section task"),
        ("soil_sin: {ros__parameters: {}}", "unknown node 'soil_sin'.*did you mean 'soil_sim'"),
        ("soil_sim: {ros__parameters: {soil: {swel: 1}}}", "'swel' in section soil.*'swell'"),
    ],
)
def test_unknown_name_is_rejected_with_the_nearest_one_and_its_section(written, text, words):
    with pytest.raises(ParameterError, match=f"mine.yaml: .*{words}"):
        load_run_config(written(text))


@pytest.mark.parametrize(
    ("text", "parameter"),
    [
        ("- swell", "no sections"),
        ("soil: 3", "soil"),
        ("soil: [1, 2]", "soil"),
        ("soil: {1: 2}", "1"),
        ("1: {swell: 0.1}", "1"),
        ("soil: {swell: much}", "swell"),
        ("soil: {swell: .nan}", "swell"),
        ("soil: {swell: 9.0}", r"soil\.swell is 9.0"),
        ("task: {cycles: 2.5}", r"task\.cycles is 2.5"),
        ("task: {cycles: true}", "cycles"),
        ("task: {approach_distance: -1.0}", "approach_distance"),
        ("stepping: {payload_coupling: 1}", "payload_coupling"),
        ("behaviour: {min_radius: 7.0, max_radius: 7.5}", "max_radius"),
        ("soil_sim: {ros__parameters: 3}", "soil_sim"),
        ("soil: {swell: 0.1", "not YAML"),
        ("\x00", "not YAML"),
    ],
)
def test_invalid_file_is_rejected_with_its_name_and_the_parameter(written, text, parameter):
    with pytest.raises(ParameterError, match=rf"mine.yaml(.|\n)*{parameter}"):
        load_run_config(written(text))


def test_file_that_is_not_text_is_rejected(tmp_path):
    path = tmp_path / "photo.yaml"
    path.write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ParameterError, match=r"photo.yaml"):
        load_run_config(path)


@pytest.mark.parametrize("text", [None, "machine: machines/crane.yaml"])
def test_missing_file_is_rejected(written, text):
    with pytest.raises(ConfigError):
        load_run_config("dmo.yaml" if text is None else written(text))


def test_command_prints_the_error_and_exits_with_2(written, capsys):
    assert cli.main(["demo", "--config", str(written("soil: {swell: 9.0}"))]) == 2
    assert "swell is 9.0" in capsys.readouterr().err


def test_dumper_hauls_as_many_loads_as_the_excavator_loads(written):
    config = load_run_config(written("task: {loads: 5, full_fill: 0.6}"), base="demo_load.yaml")
    assert (config.haul.loads, config.haul.full_fill) == (5, 0.6)
    assert config.truck_machine.name == "dumper"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("haul: {loads: 5}", "haul.loads"),
        ("haul: {full_fill: 0.9}", "haul.full_fill"),
        ("task: {truck: /mine/truck}", "task.truck"),
        ("task: {truck: /site/digger}", "task.truck"),
    ],
)
def test_tasks_that_do_not_fit_each_other_are_rejected(written, text, named):
    with pytest.raises(ParameterError, match=named):
        load_run_config(written(text), base="demo_load.yaml")


def test_file_with_two_operators_is_rejected():
    with pytest.raises(ParameterError, match="2 nodes dig_operator"):
        load_run_config("site_operators.yaml")
