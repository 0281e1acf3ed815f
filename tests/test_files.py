"""Files that appear whole or not at all, even after a power failure."""

import os
from pathlib import Path

import pytest
from meshes import cube

from balloon_warp.files import whole_file
from balloon_warp.mesh.obj import write_obj
from balloon_warp.outputs.npz import write_npz


def write_text(path: Path) -> None:
    with whole_file(path) as temporary:
        temporary.write_text("new")


def write_arrays(path: Path) -> None:
    with whole_file(path) as temporary:
        write_npz(temporary, [("place", cube().points)])


@pytest.mark.parametrize("write", [write_text, write_arrays, lambda path: write_obj(path, cube())])
def test_a_file_is_on_the_disk_before_it_has_its_name_and_its_name_follows(write, tmp_path, monkeypatch):
    """A file is flushed to disk before its rename, and its folder after: otherwise a crash of the machine, which no
    test can have, leaves an empty file in the place of a good one."""
    path = tmp_path / "file"
    path.write_text("good")
    happened: list[tuple[str, int, int]] = []
    flush, replace = os.fsync, os.replace

    def watch_flush(descriptor: int) -> None:
        flush(descriptor)
        happened.append(("on the disk", os.fstat(descriptor).st_ino, os.fstat(descriptor).st_size))

    def watch_replace(source: Path, target: Path) -> None:
        assert path.read_text() == "good"
        happened.append(("named", source.stat().st_ino, source.stat().st_size))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", watch_flush)
    monkeypatch.setattr(os, "replace", watch_replace)
    write(path)
    file = path.stat().st_ino, path.stat().st_size
    assert happened[:2] == [("on the disk", *file), ("named", *file)]
    assert [each[:2] for each in happened[2:]] == [("on the disk", tmp_path.stat().st_ino)]
    assert list(tmp_path.iterdir()) == [path]
