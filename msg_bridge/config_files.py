"""Find the configuration files that come with the package, wherever it is installed.

They are in one of three places:

- a checkout: `config/` beside the packages;
- a colcon or wheel install: `<prefix>/share/earthmoving_sim/config`, where `<prefix>` is above the
  folder the packages lie in (`<prefix>/lib/pythonX.Y/site-packages`);
- an install into another folder of the same environment: `sys.prefix/share/earthmoving_sim/config`.
"""

import sys
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["ConfigError", "config_folder", "find_config", "shipped_configs"]

_SHARE = Path("share", "earthmoving_sim", "config")
_PACKAGES = Path(__file__).resolve().parents[1]  # the folder that holds msg_bridge and its siblings


class ConfigError(EarthmovingError):
    """A configuration file is not where it was looked for."""


def find_config(name: str) -> Path:
    """The file `name`: the user's own if that path exists, else the one shipped under that name.

    `name` is an absolute path, a path relative to the working folder, or the path of a shipped file
    inside the configuration folder, such as `"soil_sim.yaml"` or `"machines/excavator.yaml"`.

    Raises `ConfigError`, saying where it looked and what is shipped, if there is no such file.
    """
    if not name:
        raise ConfigError(
            "The name of a configuration file is empty; give a path or a shipped name."
        )
    own = Path(name).expanduser()
    looked = [Path.cwd() / own]
    if not own.is_absolute():
        looked += [folder / own for folder in _candidate_folders()]
    for path in looked:
        if path.is_file():
            return path
    raise ConfigError(
        f"There is no configuration file {name!r}. Looked for:"
        + "".join(f"\n  {path}" for path in looked)
        + f"\nShipped with the package: {', '.join(shipped_configs()) or 'nothing was found'}."
    )


def config_folder() -> Path | None:
    """The folder of the shipped configuration files, or `None` if it is missing."""
    return next((folder for folder in _candidate_folders() if folder.is_dir()), None)


def shipped_configs() -> list[str]:
    """Names, as `find_config` takes them, of all shipped YAML files, in alphabetical order."""
    folder = config_folder()
    if folder is None:
        return []
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.yaml"))


def _candidate_folders() -> list[Path]:
    """Folders that may hold the shipped files, best first, without duplicates."""
    if (_PACKAGES / "package.xml").is_file():  # a checkout, and no stranger's config/ beside it
        return [_PACKAGES / "config"]
    prefixes = [*_PACKAGES.parents, Path(sys.prefix)]
    return list(dict.fromkeys(prefix / _SHARE for prefix in prefixes))
