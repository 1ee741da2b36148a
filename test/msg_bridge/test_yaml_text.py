"""YAML that is read with libyaml: the same content, and deep nesting is an error."""

from __future__ import annotations

import subprocess
import sys

import pytest
import yaml

from msg_bridge.config_files import find_config
from msg_bridge.yaml_text import load_yaml


@pytest.mark.parametrize(
    "name", ["machines/excavator.yaml", "soils.yaml", "demo.yaml", "reference_2014.yaml"]
)
def test_content_is_that_of_the_parser_in_python(name: str) -> None:
    text = find_config(name).read_text(encoding="utf-8")
    assert load_yaml(text) == yaml.safe_load(text)


# In another process, which libyaml would end.
@pytest.mark.parametrize(
    "text",
    [
        "'[' * 60000",
        "'{a: ' * 60000",
        "'- ' * 60000",
        "'? ' * 60000",
        "'# text' + chr(13) + '- ' * 60000",  # a carriage return ends a line, too
    ],
)
def test_text_that_is_nested_too_deep_is_an_error(text: str) -> None:
    code = f"from msg_bridge.yaml_text import load_yaml\nload_yaml({text})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert "RecursionError" in run.stderr or "yaml." in run.stderr
