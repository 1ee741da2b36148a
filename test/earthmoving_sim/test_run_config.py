"""The file a run is made from: what is in it, and what is said when it is not good."""

from pathlib import Path

import pytest

from earthmoving_sim import cli
from earthmoving_sim.run_config import load_run_config
from msg_bridge.config_files import ConfigError
from msg_bridge.contract.errors import ParameterError


@pytest.fixture
def written(tmp_path):
    """Write a file of parameters and give its path."""

    def write(text: str) -> Path:
        path = tmp_path / "mine.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_shipped_demo_loads():
    config = load_run_config("demo.yaml")
    assert config.soil.repose_angle == 35.0
    assert config.soil.swell == 0.15
    assert config.particles.nominal_volume == 1_000_000
    assert config.stepping.tick_period == pytest.approx(0.01)
    assert (config.behaviour.min_radius, config.behaviour.max_radius) == (4.4, 7.3)
    assert config.task.cycles == 5
    assert config.machine.bucket.width == 1.2


def test_what_is_not_named_keeps_its_default(written):
    config = load_run_config(written("behaviour: {max_radius: 7.0}"))
    assert config.behaviour.max_radius == 7.0
    assert config.behaviour.min_radius == 4.4
    assert config.task.cycles == 5


@pytest.mark.parametrize("text", ["", "# only a comment", "run:", "operator: {}"])
def test_empty_file_or_section_is_all_defaults(written, text):
    assert load_run_config(written(text)).run.seed == 0


def test_values_asked_for_stand_above_those_of_the_file(written):
    config = load_run_config(written("task: {cycles: 3}\nrun: {seed: 4}"), {"cycles": 7})
    assert (config.task.cycles, config.run.seed) == (7, 4)


def test_values_asked_for_are_checked_too(written):
    with pytest.raises(ParameterError, match=r"DigTaskParams.cycles is 0"):
        load_run_config(written(""), {"cycles": 0})


def test_machine_of_ones_own_is_used(written, tmp_path):
    shipped = (Path(__file__).parents[2] / "config/machines/excavator.yaml").read_text()
    own = tmp_path / "narrow.yaml"
    own.write_text(shipped.replace("width: 1.2", "width: 0.9"), encoding="utf-8")
    assert load_run_config(written(f"machine: {own}")).machine.bucket.width == 0.9


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "sole: {swell: 0.1}",
            "mine.yaml has the unknown sole; its sections are machine",
        ),
        ("- swell", "mine.yaml has no sections; its sections are machine"),
        ("soil: 3", "mine.yaml: soil is 3; give a mapping of parameters"),
        ("soil: [1, 2]", "soil is .1, 2.; give a mapping"),
        ("soil: 0", "soil is 0; give a mapping"),
        ("soil: {swel: 0.1}", "SoilParams has no parameter swel; it has .*swell"),
        ("soil: {swell: much}", "SoilParams.swell is 'much'; give a finite number"),
        ("soil: {swell: .nan}", "SoilParams.swell is nan; give a finite number"),
        ("task: {cycles: 2.5}", "DigTaskParams.cycles is 2.5; give a whole number"),
        ("task: {cycles: true}", "DigTaskParams.cycles is True; give a whole number"),
        (
            "shift: {approach: -1.0}",
            "DigTaskParams.approach is -1.0 m; give a value from 0.0 to 20.0 m",
        ),
        (
            "stepping: {payload_coupling: 1}",
            "MachineSimParams.payload_coupling is 1; give true or false",
        ),
        (
            "behaviour: {min_radius: 7.0, max_radius: 7.5}",
            "max_radius is 7.5 m and min_radius 7.0 m; give a max_radius .* 1 m more",
        ),
        ("soil: {swell: 0.1", "mine.yaml is not YAML"),
        ("\x00", "mine.yaml is not YAML"),
    ],
)
def test_bad_file_is_refused_with_its_fix(written, text, words):
    with pytest.raises(ParameterError, match=words):
        load_run_config(written(text))


@pytest.mark.parametrize("text", ["soil: {1: 2}", "1: {swell: 0.1}", "1: {}\nsole: {}"])
def test_names_that_are_not_texts_are_refused(written, text):
    with pytest.raises(ParameterError, match="1"):
        load_run_config(written(text))


@pytest.mark.parametrize("text", ["soil: {swell: 9.0}", "soil: {swel: 0.1}", "run: {cycles: 0}"])
def test_bad_parameter_is_told_with_the_file_it_is_in(written, text):
    with pytest.raises(ParameterError, match=r"mine.yaml"):
        load_run_config(written(text))


def test_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "photo.yaml"
    path.write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(ParameterError, match=r"photo.yaml is not YAML"):
        load_run_config(path)


def test_file_that_is_missing_is_looked_for_and_what_is_shipped_is_told():
    with pytest.raises(ConfigError, match=r"no configuration file 'dmo.yaml'(.|\n)*demo.yaml"):
        load_run_config("dmo.yaml")


def test_machine_that_is_missing_is_named(written):
    with pytest.raises(ConfigError, match=r"no configuration file 'machines/crane.yaml'"):
        load_run_config(written("machine: machines/crane.yaml"))


def test_command_line_tells_it_in_a_sentence_and_exits_with_2(written, capsys):
    assert cli.main(["demo", "--config", str(written("soil: {swell: 9.0}"))]) == 2
    assert "give a value from" in capsys.readouterr().err
