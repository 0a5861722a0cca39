"""Files that are there only when they are whole."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from small_files import no_larger_files

from horizon_sensor_ros.tools.command_errors import CommandError
from horizon_sensor_ros.tools.output_files import check_place, remove_unfinished, written_whole


def test_files_take_their_places_together(tmp_path: Path) -> None:
    one, other = tmp_path / "new" / "one.txt", tmp_path / "other.txt"
    other.write_text("old")
    other.chmod(0o640)
    with written_whole(one, other) as (fresh_one, fresh_other):
        assert (fresh_one.name, fresh_other.name) == ("one.txt", "other.txt")
        fresh_one.write_text("1")
        fresh_other.write_text("2")
        assert not one.exists()
        assert other.read_text() == "old"
    assert (one.read_text(), other.read_text()) == ("1", "2")
    assert other.stat().st_mode & 0o777 == 0o640
    assert sorted(tmp_path.iterdir()) == [one.parent, other]
    assert list(one.parent.iterdir()) == [one]


def test_what_cannot_be_written_leaves_the_older_one(tmp_path: Path) -> None:
    old, new = tmp_path / "old.txt", tmp_path / "some" / "where" / "new.txt"
    old.write_text("old")

    def write() -> None:
        with written_whole(old, new) as (fresh_old, fresh_new), no_larger_files(100):
            fresh_old.write_text("new")
            fresh_new.write_text("long" * 100)

    with pytest.raises(CommandError, match=f"^cannot write {old} and {new}: File too large$"):
        write()
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


def test_what_is_interrupted_leaves_nothing(tmp_path: Path) -> None:
    def write(then: Callable[[], None]) -> None:
        with written_whole(tmp_path / "a" / "b") as (fresh,):
            fresh.write_text("half of")
            then()

    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(interrupt)
    assert list(tmp_path.iterdir()) == []
    # As by a signal's handler, after which there would be no more.
    with pytest.raises(CommandError, match="cannot write"):
        write(remove_unfinished)
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    real, link = tmp_path / "elsewhere" / "page", tmp_path / "link"
    real.write_text("old")
    link.symlink_to(real)
    with written_whole(link) as (fresh,):
        fresh.write_text("new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_a_device_is_written_to_as_it_is() -> None:
    full = Path("/dev/full")
    with written_whole(Path("/dev/null")) as (fresh,):
        fresh.write_text("anything")

    def write() -> None:
        with written_whole(full) as (fresh,):
            fresh.write_text("anything")

    with pytest.raises(CommandError, match="/dev/full: No space left"):
        write()
    assert full.is_char_device()


def test_a_place_can_be_asked_for_before_the_work(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    for path in (file, tmp_path / "new" / "file", Path("/dev/null")):
        check_place(path)
    with pytest.raises(CommandError, match=f"^cannot write {tmp_path}: it is a folder$"):
        check_place(tmp_path)
    with pytest.raises(CommandError, match=f"^cannot write {file}/new: Not a directory$"):
        check_place(file / "new")
    assert list(tmp_path.iterdir()) == [file]
