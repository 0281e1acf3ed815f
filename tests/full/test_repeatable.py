"""Repeatability: the same inputs give the same files, byte by byte, and a world's rows do not depend on its batch."""

from pathlib import Path

import pytest
from small_batch import struck

from balloon_warp import Scene, animate, run_batch

WAYS = {schedule: (struck(frames=4), schedule) for schedule in ("gather", "octets", "lanes", "block")}
WAYS["projective"] = (struck(frames=4, solver="projective"), "auto")


@pytest.fixture(params=WAYS)
def way(request: pytest.FixtureRequest, device: str) -> tuple[Scene, str]:
    """Return a scene, and the schedule that simulates it."""
    if device != "cpu" and request.param in ("octets", "lanes"):
        pytest.skip("simulates on the CPU")
    return WAYS[request.param]


def test_a_run_and_a_batch_have_the_same_bytes_again(way: tuple[Scene, str], device: str, tmp_path: Path):
    scene, schedule = way

    def written(folder: Path, **changes: float) -> dict[str, bytes]:
        rows(way, device, folder, 9, export=[0, 8])
        animate(scene.model_copy(update=changes), folder / "run.usdc", device=device, schedule=schedule)
        return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "manifest.json"}

    first = written(tmp_path / "first")
    assert len(first) == 6
    assert written(tmp_path / "again") == first
    assert written(tmp_path / "other", gravity=9.0)["run.usdc"] != first["run.usdc"]


def test_the_rows_of_a_world_are_those_of_any_batch(way: tuple[Scene, str], device: str, tmp_path: Path):
    large = rows(way, device, tmp_path, 19)
    for worlds in (1, 3, 8):
        assert rows(way, device, tmp_path, worlds) == {world: large[world] for world in range(worlds)}
    assert large[1] != large[2]


def rows(
    way: tuple[Scene, str], device: str, folder: Path, worlds: int, export: list[int] | None = None
) -> dict[int, list[str]]:
    """Return each world's rows of the table of a batch, without the world's number."""
    scene, schedule = way
    vary = {"gravity": [9.0 + 0.1 * world for world in range(worlds)]}
    run_batch(scene, folder, worlds, vary, export=export or [], device=device, schedule=schedule)
    found: dict[int, list[str]] = {world: [] for world in range(worlds)}
    for line in (folder / "table.csv").read_text().splitlines()[1:]:
        world, _, row = line.partition(",")
        found[int(world)].append(row)
    return found
