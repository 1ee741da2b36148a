"""The source of the software is named by a digest."""

from pathlib import Path

import pytest

from msg_bridge.source_digest import digest_of_sources


def edit(folder: Path) -> None:
    (folder / "deep" / "module.py").write_text("VALUE = 2\n")


def rename(folder: Path) -> None:
    (folder / "deep" / "module.py").rename(folder / "deep" / "other.py")


def add(folder: Path) -> None:
    (folder / "new.py").write_text("")


@pytest.mark.parametrize("change", [edit, rename, add])
def test_digest_changes_with_the_source_and_not_with_its_place(tmp_path, change):
    folders = [tmp_path / place / "package" for place in ("here", "there")]
    for folder in folders:
        (folder / "deep").mkdir(parents=True)
        (folder / "__init__.py").write_text("")
        (folder / "deep" / "module.py").write_text("VALUE = 1\n")
        (folder / "data.txt").write_text(str(folder))
    assert digest_of_sources(folders[:1]) == digest_of_sources(folders[1:])
    change(folders[1])
    assert digest_of_sources(folders[:1]) != digest_of_sources(folders[1:])
