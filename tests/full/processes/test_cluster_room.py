"""Batch on workers of which some have no room: the others do all, and the files are the same."""

import functools
import os
from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp import Cluster, InputError, Scene, run_batch
from balloon_warp.model import memory
from balloon_warp.scene import Balloon
from balloon_warp.sweep import shares
from balloon_warp.warp_logging import quiet_warp

WORLDS = 8


def fill_first(folder: str, most: int) -> None:
    """Let the memory of a worker be full, if it is one of the first to ask."""
    quiet_warp()
    claims = [Path(folder) / str(number) for number in range(most)]
    if any(claim.exists() and claim.read_text() == str(os.getpid()) for claim in claims):
        return
    for claim in claims:
        try:
            with claim.open("x") as file:
                file.write(str(os.getpid()))
        except FileExistsError:
            continue
        memory.free_memory = lambda device: 1024
        return


@pytest.fixture(autouse=True)
def small_shares(monkeypatch) -> None:
    monkeypatch.setitem(shares.GRAIN, "cpu", shares.Grain(1, 1))
    monkeypatch.setattr(shares, "SHARES", 4)


def simulate(folder: Path, cluster: Cluster | None, notes: list[str]) -> bytes:
    """Simulate a small batch, and return its table."""
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3))], frames=3)
    vary = {"balloon.mass": np.linspace(0.1, 0.2, WORLDS)}
    run_batch(scene, folder, WORLDS, vary, device=None if cluster else "cpu", cluster=cluster, on_note=notes.append)
    return (folder / "table.csv").read_bytes()


def test_others_do_what_does_not_fit(tmp_path):
    """Notes tell of the full worker once, and the table is that of one process."""
    notes: list[str] = []
    (claims := tmp_path / "claims").mkdir()
    cluster = Cluster(workers=2, prepare=functools.partial(fill_first, str(claims), 1))
    table = simulate(tmp_path / "two", cluster, notes)
    assert len(notes) == 1
    assert "2 worlds do not fit: they need" in notes[0]
    assert notes[0].endswith("; the other workers do its share")
    assert table == simulate(tmp_path / "one", None, [])


def test_where_all_are_full_the_batch_is_refused(tmp_path):
    (claims := tmp_path / "claims").mkdir()
    cluster = Cluster(workers=2, prepare=functools.partial(fill_first, str(claims), 2))
    with pytest.raises(InputError, match=r"worlds do not fit: they need"):
        simulate(tmp_path / "out", cluster, [])
    assert not (tmp_path / "out" / "table.csv").exists()
