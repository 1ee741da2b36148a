"""Configuration files are found in a checkout, a wheel install and a colcon install."""

import sys
from pathlib import Path

import pytest

from msg_bridge import config_files
from msg_bridge.config_files import ConfigError, config_folder, find_config, shipped_configs
from msg_bridge.contract.errors import EarthmovingError


def file(path: Path, text: str = "shipped") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.fixture
def checkout(tmp_path, monkeypatch) -> Path:
    """Return the root of a checkout, and set a working folder outside of it."""
    root, elsewhere = tmp_path / "checkout", tmp_path / "elsewhere"
    file(root / "package.xml")
    elsewhere.mkdir()
    monkeypatch.setattr(config_files, "PACKAGES_FOLDER", root)
    monkeypatch.chdir(elsewhere)
    return root


def test_checkout_config_is_found(checkout):
    shipped = file(checkout / "config/machines/excavator.yaml")
    assert find_config("machines/excavator.yaml") == shipped


def test_colcon_install_config_is_found(tmp_path, monkeypatch):
    prefix = tmp_path / "install/earthmoving_sim"
    monkeypatch.setattr(config_files, "PACKAGES_FOLDER", prefix / "lib/python3.12/site-packages")
    shipped = file(prefix / "share/earthmoving_sim/config/soil.yaml")
    assert find_config("soil.yaml") == shipped


def test_wheel_install_config_is_found_below_the_environment(tmp_path, monkeypatch):
    monkeypatch.setattr(config_files, "PACKAGES_FOLDER", tmp_path / "anywhere")
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "venv"))
    shipped = file(tmp_path / "venv/share/earthmoving_sim/config/soil.yaml")
    assert find_config("soil.yaml") == shipped


def test_config_folder_of_another_package_in_site_packages_is_ignored(tmp_path, monkeypatch):
    monkeypatch.setattr(config_files, "PACKAGES_FOLDER", tmp_path)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    file(tmp_path / "config/soil.yaml")
    with pytest.raises(ConfigError):
        find_config("soil.yaml")


def test_user_file_overrides_the_shipped_one(checkout):
    file(checkout / "config/soil.yaml")
    file(Path("soil.yaml"), "user's")
    assert find_config("soil.yaml").read_text() == "user's"


def test_absolute_path_is_used_unchanged(checkout, tmp_path):
    own = file(tmp_path / "own.yaml")
    assert find_config(str(own)) == own


def test_folder_is_not_a_config_file(checkout):
    file(checkout / "config/machines/excavator.yaml")
    with pytest.raises(ConfigError):
        find_config("machines")


def test_error_of_a_missing_file_lists_folders_and_shipped_files(checkout):
    file(checkout / "config/soil.yaml")
    with pytest.raises(ConfigError) as error:
        find_config("soli.yaml")
    message = str(error.value)
    assert str(Path.cwd() / "soli.yaml") in message
    assert str(checkout / "config/soli.yaml") in message
    assert "Shipped with the package: soil.yaml" in message


def test_empty_name_is_rejected(checkout):
    with pytest.raises(ConfigError, match="empty"):
        find_config("")


def test_config_error_is_an_error_of_the_package():
    assert issubclass(ConfigError, EarthmovingError)


def test_shipped_names_are_found(checkout):
    for name in ("soil.yaml", "machines/excavator.yaml", "machines/README.md"):
        file(checkout / "config" / name)
    names = shipped_configs()
    assert names == ["machines/excavator.yaml", "soil.yaml"]
    assert all(find_config(name).is_relative_to(checkout) for name in names)


def test_install_without_config_ships_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(config_files, "PACKAGES_FOLDER", tmp_path)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert config_folder() is None
    assert shipped_configs() == []
