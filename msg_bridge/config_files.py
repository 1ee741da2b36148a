"""Find the configuration files that are installed with the package.

Their folder depends on the kind of installation:

- a checkout: `config/` beside the packages;
- a colcon or wheel install: `<prefix>/share/earthmoving_sim/config`, where `<prefix>` is above the
  folder of the packages (`<prefix>/lib/pythonX.Y/site-packages`);
- an installation into another folder of the same environment:
  `sys.prefix/share/earthmoving_sim/config`.
"""

import sys
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["PACKAGES_FOLDER", "ConfigError", "config_folder", "find_config", "shipped_configs"]

_SHARE = Path("share", "earthmoving_sim", "config")
PACKAGES_FOLDER = Path(__file__).resolve().parents[1]
"""Folder of the package msg_bridge and its siblings."""


class ConfigError(EarthmovingError):
    """A configuration file does not exist."""


def find_config(name: str) -> Path:
    """Return the path of a file: the user's own if it exists, else the shipped one.

    Args:
        name: an absolute path, a path relative to the working folder, or the path of a shipped file
            in the configuration folder, such as `"soil_sim.yaml"` or `"machines/excavator.yaml"`.

    Raises:
        ConfigError: there is no such file; the message lists the searched paths and shipped names.
    """
    if not name:
        raise ConfigError(
            "The name of a configuration file is empty; give a path or a shipped name."
        )
    own = Path(name).expanduser()
    searched = [Path.cwd() / own]
    if not own.is_absolute():
        searched += [folder / own for folder in _candidate_folders()]
    for path in searched:
        if path.is_file():
            return path
    raise ConfigError(
        f"There is no configuration file {name!r}. Searched paths:"
        + "".join(f"\n  {path}" for path in searched)
        + f"\nShipped with the package: {', '.join(shipped_configs()) or 'no files'}."
    )


def config_folder() -> Path | None:
    """Return the folder of the shipped configuration files; None if it is missing."""
    return next((folder for folder in _candidate_folders() if folder.is_dir()), None)


def shipped_configs() -> list[str]:
    """Return the names, for `find_config`, of all shipped YAML files, in alphabetical order."""
    folder = config_folder()
    if folder is None:
        return []
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.yaml"))


def _candidate_folders() -> list[Path]:
    """Return the folders that may contain the shipped files, the preferred first, each once."""
    if (PACKAGES_FOLDER / "package.xml").is_file():  # a checkout, not another package's config/
        return [PACKAGES_FOLDER / "config"]
    prefixes = [*PACKAGES_FOLDER.parents, Path(sys.prefix)]
    return list(dict.fromkeys(prefix / _SHARE for prefix in prefixes))
