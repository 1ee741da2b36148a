"""Bags that were cut off or damaged are recovered as far as their bytes allow."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability
from rosbags.rosbag2 import Reader
from support.text_bags import (
    ATTACHMENT,
    NUMBER,
    numbers_in,
    recover,
    segments_of,
    write_bag,
)

from earthmoving_sim.cli import main
from msg_bridge.bag.mcap_index import BagReadError, FileSegment
from msg_bridge.bag.mcap_records import RECORD_HEADER
from msg_bridge.bag.reader import BagReader
from msg_bridge.bag.writer import COMPRESSIONS
from msg_bridge.bag_recovery import recover_bag


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_file_cut_off_anywhere_loses_only_the_messages_behind_the_cut(
    tmp_path: Path, compression: str
) -> None:
    file = write_bag(tmp_path / "dig", compression)
    content = file.read_bytes()
    starts = [segment.offset for segment in segments_of(file)]
    for case, cut in enumerate(random.Random(1).sample(range(starts[0] + 8000, starts[-1]), 12)):
        folder = tmp_path / f"case_{case}"
        (folder / "cut").mkdir(parents=True)
        (folder / "cut/cut_0.mcap").write_bytes(content[:cut])
        recovered = recover_bag(folder / "cut", folder / "recovered")
        numbers = numbers_in(folder / "recovered")
        assert numbers == list(range(len(numbers)))
        complete = sum(start < cut for start in starts) - 1  # number of complete chunks
        messages_per_chunk = NUMBER / len(starts)
        assert len(numbers) >= messages_per_chunk * complete - 1
        assert not recovered.files[0].has_losses
        assert not recovered.is_intact


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_zeros_at_the_end_are_no_messages_and_no_damage(tmp_path: Path, compression: str) -> None:
    """A system crash leaves them, also within a chunk."""
    file = write_bag(tmp_path / "dig", compression)
    content = file.read_bytes()
    segments = segments_of(file)
    cut = segments[10].offset + segments[10].length // 2
    file.write_bytes(content[:cut] + bytes(50_000))
    (recovered,) = recover(file).files
    numbers = numbers_in(tmp_path / "recovered")
    assert numbers == list(range(len(numbers)))
    assert segments[10].start_ns <= len(numbers) * 10**9 < segments[11].start_ns
    assert not recovered.has_losses


def test_damaged_last_chunk_of_a_complete_file_is_a_loss(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "dig")
    content = bytearray(file.read_bytes())
    content[segments_of(file)[-1].offset - 8] ^= 0x55  # its length
    file.write_bytes(content)
    (recovered,) = recover(file).files
    assert len(numbers_in(tmp_path / "recovered")) < NUMBER
    assert recovered.has_losses


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("damage", ["bytes changed", "bytes missing", "length changed"])
def test_only_the_damaged_chunk_is_lost(tmp_path: Path, compression: str, damage: str) -> None:
    file = write_bag(tmp_path / "dig", compression)
    segments = segments_of(file)
    damaged, following = segments[5], segments[6]
    content = bytearray(file.read_bytes())
    if damage == "bytes changed":
        content[damaged.offset + 1000] ^= 0x55
    elif damage == "bytes missing":
        del content[damaged.offset + 1000 : damaged.offset + 1400]
    else:
        content[damaged.offset - 8 : damaged.offset] = (10**6).to_bytes(8, "little")
    file.write_bytes(content)
    (recovered,) = recover(file).files
    numbers = numbers_in(tmp_path / "recovered")
    first, last = damaged.start_ns // 10**9, following.start_ns // 10**9
    assert numbers == [*range(first), *range(last, NUMBER)]
    assert recovered.has_losses
    if damage == "bytes changed":
        ((part),) = recovered.damages
        assert (part.start, part.end) == (first * 10**9, (last - 1) * 10**9)


@pytest.mark.parametrize("part", ["index of messages", "summary", "footer"])
def test_damaged_index_is_made_again(tmp_path: Path, part: str) -> None:
    file = write_bag(tmp_path / "dig")
    segment = segments_of(file)[5]
    content = bytearray(file.read_bytes())
    summary_start = int.from_bytes(content[-28:-20], "little")
    index_start = segment.offset + segment.length
    if part == "footer":
        content[-150:-30] = b"x" * 120
    else:
        content[(index_start if part == "index of messages" else summary_start) + 20] ^= 0x55
    file.write_bytes(content)
    (recovered,) = recover(file).files
    ((text),) = [each.text for each in recovered.damages]
    assert part.replace("footer", "summary") in text
    assert "it is made again, and nothing is lost" in text
    assert not recovered.has_losses
    assert numbers_in(tmp_path / "recovered") == list(range(NUMBER))


def test_channels_of_a_damaged_chunk_are_those_of_the_summary(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "dig")
    segments = segments_of(file)
    content = bytearray(file.read_bytes())
    content[segments[0].offset + 1000] ^= 0x55
    file.write_bytes(content)
    recover(file)
    assert numbers_in(tmp_path / "recovered") == [*range(segments[1].start_ns // 10**9, NUMBER)]
    cut = file.parent / "cut.mcap"
    cut.write_bytes(content[: segments[-1].offset])  # without a summary
    with pytest.raises(BagReadError, match=r"no message .*: cut.mcap .* bytes\): .*topic of"):
        recover_bag(cut, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_attachments_files_qos_and_custom_data_are_kept(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "dig", num_files=4)
    last = file.with_name("dig_3.mcap")
    last.write_bytes(last.read_bytes()[:-100])
    recovered = recover_bag(tmp_path / "dig", tmp_path / "recovered")
    assert [each.is_complete for each in recovered.files] == [True, True, True, False]
    assert numbers_in(tmp_path / "recovered") == list(range(NUMBER))
    reader = BagReader(tmp_path / "recovered")
    assert reader.read_attachment("a/soils.yaml") == ATTACHMENT
    assert len(reader.files) == 4
    with Reader(tmp_path / "recovered") as bag:
        (connection,) = bag.connections
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        (qos,) = connection.ext.offered_qos_profiles
        assert qos.durability is QosDurability.TRANSIENT_LOCAL
    metadata = yaml.safe_load((tmp_path / "recovered/metadata.yaml").read_text())
    custom = metadata["rosbag2_bagfile_information"]["custom_data"]
    assert custom["format_version"] == "2"
    assert json.loads(custom["recovered"])["dig_3.mcap"]["had_end"] is False


@pytest.mark.parametrize("is_renamed", [True, False])
def test_bag_without_a_file_that_metadata_names_is_written_again(
    tmp_path: Path, is_renamed: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_bag(tmp_path / "dig", num_files=2)
    if is_renamed:
        file.rename(file.with_name("dig.mcap"))
    else:
        file.unlink()
    with pytest.raises(BagReadError, match="earthmoving recover"):
        BagReader(tmp_path / "dig")
    assert main(["recover", str(tmp_path / "dig"), "--json"]) == (0 if is_renamed else 1)
    assert json.loads(capsys.readouterr().out)["missing_files"] == [file.name]
    found = sorted(numbers_in(tmp_path / "dig-recovered"))
    assert found == list(range(0 if is_renamed else NUMBER // 2, NUMBER))


@pytest.mark.parametrize("content", [b"", b"text"])
def test_file_without_any_record_does_not_hinder_the_others(
    tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    last = sorted(write_bag(tmp_path / "dig", num_files=4).parent.glob("*.mcap"))[-1]
    last.write_bytes(content)
    assert main(["recover", str(tmp_path / "dig")]) == (1 if content else 0)
    assert str(last) in capsys.readouterr().out
    assert sorted(numbers_in(tmp_path / "dig-recovered")) == list(range(NUMBER * 3 // 4))


def test_folder_of_a_bag_without_messages_is_not_left(tmp_path: Path) -> None:
    (tmp_path / "dig").mkdir()
    file = tmp_path / "dig/dig_0.mcap"
    file.write_bytes(b"")
    for _ in range(2):
        with pytest.raises(BagReadError, match="is empty"):
            recover(file)
    assert not (tmp_path / "recovered").exists()


@pytest.mark.parametrize("is_intact", [True, False])
def test_output_folder_is_as_before_if_nothing_is_written(tmp_path: Path, is_intact: bool) -> None:
    file = write_bag(tmp_path / "dig")
    if not is_intact:
        file.write_bytes(b"text")
    empty, link = tmp_path / "empty", tmp_path / "link"
    empty.mkdir()
    link.symlink_to(empty)
    for folder in (tmp_path / "made/too/recovered", empty, link):
        assert main(["recover", str(file.parent), "-o", str(folder)]) == (0 if is_intact else 2)
    assert not (tmp_path / "made").exists()
    assert link.is_symlink()
    assert list(empty.iterdir()) == []


def test_bag_is_written_through_a_link_to_an_empty_folder(tmp_path: Path) -> None:
    file = write_bag(tmp_path / "dig")
    file.write_bytes(file.read_bytes()[:-100])
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "disk")
    assert main(["recover", str(file.parent), "-o", str(tmp_path / "link")]) == 0
    assert numbers_in(tmp_path / "disk") == list(range(NUMBER))


@pytest.mark.parametrize(
    ("output", "text"),
    [
        ("broken", "is a symbolic link to nowhere, which does not exist"),
        ("broken/below", "is a symbolic link to nowhere, which does not exist"),
        ("file", "is a file; give a folder by --output"),
        ("file/below", "is a file; give a folder by --output"),
    ],
)
def test_output_that_is_no_folder_is_rejected(
    tmp_path: Path, output: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_bag(tmp_path / "dig")
    (tmp_path / "broken").symlink_to("nowhere")
    (tmp_path / "file").write_text("text")
    for command in ("recover", "report", "export"):
        assert main([command, str(file), "-o", str(tmp_path / output)]) == 2
        assert text in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "text"


def damage_in_chunk(content: bytearray, segment: FileSegment) -> None:
    content[segment.offset + 1000] ^= 0x55


def bytes_between_chunks(content: bytearray, segment: FileSegment) -> None:
    content[segment.offset - RECORD_HEADER.size : segment.offset - RECORD_HEADER.size] = b"x" * 70


def cut_in_chunk(content: bytearray, segment: FileSegment) -> None:
    del content[segment.offset + segment.length // 2 :]


@pytest.mark.parametrize(
    ("damage", "lines"),
    [
        (
            damage_in_chunk,
            ["bytes: damaged chunk: its checksum is ", "; its content is lost; messages from "],
        ),
        (bytes_between_chunks, [", 70 bytes: no records; skipped"]),
        (cut_in_chunk, [" from a chunk that was cut off", "messages, has no end"]),
    ],
)
def test_command_describes_each_damage(
    tmp_path: Path,
    damage: Callable[[bytearray, FileSegment], None],
    lines: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = write_bag(tmp_path / "dig", "none")
    content = bytearray(file.read_bytes())
    damage(content, segments_of(file)[5])
    file.write_bytes(content)
    main(["recover", str(tmp_path / "dig")])
    output = capsys.readouterr().out
    assert [line for line in lines if line not in output] == [], output


def test_command_reports_what_was_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write_bag(tmp_path / "dig")
    assert main(["recover", str(tmp_path / "dig")]) == 0
    assert "complete and undamaged" in capsys.readouterr().out
    assert not (tmp_path / "dig-recovered").exists()
    content = bytearray(file.read_bytes())
    content[segments_of(file)[5].offset + 1000] ^= 0x55
    file.write_bytes(content)
    assert main(["recover", str(tmp_path / "dig"), "--json"]) == 1
    (entry,) = json.loads(capsys.readouterr().out)["files"]
    assert len(entry["damages"]) == 1
    assert entry["messages"] == len(numbers_in(tmp_path / "dig-recovered"))
    assert main(["recover", str(tmp_path / "dig")]) == 2  # the folder is not empty
    (tmp_path / "text.mcap").write_text("text")
    assert main(["recover", str(tmp_path / "text.mcap")]) == 2
