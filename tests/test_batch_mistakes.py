"""Refusals of a batch before it begins, and the files that it leaves alone."""

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_batch import FRAMES, scene, write_meshes

from balloon_warp import Cluster, InputError, Scene, load_scene, run_batch
from balloon_warp.device import pick_device
from balloon_warp.model import Model, lay_out, memory, shape, world_bytes
from balloon_warp.schedules.lanes import LanesSchedule
from balloon_warp.sweep import batch as batch_module
from balloon_warp.sweep import memory as sweep_memory
from balloon_warp.sweep.groups import plan_groups


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_meshes(tmp_path_factory.mktemp("meshes"))


def never(*_: Any) -> None:
    raise AssertionError("is not to be called")


def bytes_of_worlds(model: Model) -> int:
    return world_bytes(model) + LanesSchedule.world_bytes(model)


def test_a_failed_batch_leaves_the_good_files(tmp_path: Path):
    run_batch(scene(frames=1), tmp_path, 2, export=[0], device="cpu")
    good = {path: path.read_bytes() for path in tmp_path.iterdir()}

    def interrupt(frame: int) -> None:
        if frame == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(scene(), tmp_path, 3, export=[0, 1], device="cpu", on_frame=interrupt)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == good


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"world_count": 0}, r"^--worlds 0: expected at least 1$"),
        ({"export": [7]}, r"^export: expected worlds 0 to 4 \(got 7 to 7\)$"),
        ({"vary": {"balloon.mesh": ["a.obj"] * 3}}, r"^balloon\.mesh: expected a mesh for each of 5 worlds \(got 3\)$"),
        ({"vary": {"balloon.0.mesh": ["none.obj"] * 5}}, r"^none\.obj: no such file"),
        ({"vary": {"balloon.7.mesh": ["none.obj"] * 5}}, r"^balloon\.7\.mesh: no balloon 7, the scene has "),
        ({"folder": "missing/out"}, r"out: the folder .*missing does not exist$"),
        ({"folder": "file"}, r"file: is a file; expected a folder$"),
    ],
)
def test_mistakes_are_told_before_the_run(tmp_path: Path, change: dict, complaint: str):
    (tmp_path / "file").touch()
    arguments = {"folder": "out", "world_count": 5, "vary": {}} | change
    arguments["folder"] = tmp_path / arguments["folder"]
    with pytest.raises(InputError, match=complaint):
        run_batch(scene(), **arguments, device="cpu", on_frame=never)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("cluster", [None, Cluster(workers=2)])
def test_far_too_many_worlds_are_refused_before_they_get_values(tmp_path: Path, monkeypatch, cluster: Cluster | None):
    """The size is checked before values are drawn: a hundred million of anything do not fit into memory. The search for
    thin parts, which takes longest and adds no memory, is skipped."""
    monkeypatch.setattr(batch_module, "plan_groups", never)
    monkeypatch.setattr(shape, "relative_thickness", never)
    for overrides in ({}, {"balloon.stiffness.thin": "softer"}):
        many = load_scene(scene(frames=400), overrides)
        with pytest.raises(InputError, match=r"^100000000 worlds do not fit: they need .* GiB, and cpu has "):
            run_batch(many, tmp_path, 10**8, device=None if cluster else "cpu", cluster=cluster)
    assert list(tmp_path.iterdir()) == []


def test_what_is_refused_early_would_be_refused_late(monkeypatch: pytest.MonkeyPatch):
    """The early check of memory refuses no batch that would fit by the bytes of its table and worlds."""
    monkeypatch.setattr(memory, "free_memory", lambda device: 2**30)
    monkeypatch.setattr(sweep_memory, "MANY", 1)
    model = lay_out(plan_groups(scene(), 4096, {"balloon.mass": np.ones(4096)})[0].plan, pick_device("cpu"))
    bytes_of_all = 4096 * (bytes_of_worlds(model) + sweep_memory.table_bytes(scene()))
    for room, refused in ((1.02, False), (0.9, True)):
        monkeypatch.setattr(memory, "free_memory", lambda device, room=room: room * bytes_of_all / memory.USABLE)
        with pytest.raises(InputError, match="do not fit") if refused else contextlib.nullcontext():
            sweep_memory.require_room(scene(), 4096, ["balloon.mass"], "cpu")


def test_a_step_that_only_soft_thin_parts_allow_is_no_reason_for_an_early_refusal(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sweep_memory, "MANY", 1)
    stable = plan_groups(load_scene("squirrel_tether"), 1, {})[0].plan.substeps
    stiffer = plan_groups(load_scene("squirrel_tether", {"balloon.stiffness.thin": "alike"}), 1, {})[0].plan.substeps
    assert stable < stiffer
    sweep_memory.require_room(load_scene("squirrel_tether", {"substeps": stable}), 2, device="cpu")


def test_a_varied_value_is_told_with_its_world_in_the_whole_batch(meshes: list[Path], tmp_path: Path):
    vary = {"balloon.0.mesh": [meshes[n % 2] for n in range(5)], "balloon.mass": [1.0, 1.0, 1.0, -1.0, 1.0]}
    with pytest.raises(InputError, match=r"^balloon\.0\.mass: must be greater than 0 \(got -1\.0\), in world 3$"):
        run_batch(scene(), tmp_path, 5, vary, device="cpu")


def test_all_groups_take_the_step_of_the_stiffest_world(meshes: list[Path]):
    """The step of a batch is that of its stiffest world, whichever group that is in. All are so light that stability
    asks for more substeps than spheres do."""
    automatic = scene(substeps="auto")
    vary = {"balloon.0.mesh": [meshes[0], meshes[1], meshes[0]], "balloon.mass": [1e-4, 1e-4, 2e-5]}
    alone = [plan_groups(automatic, 1, {path: [values[n]] for path, values in vary.items()}) for n in range(3)]
    groups = plan_groups(automatic, 3, vary)
    assert [group.worlds.tolist() for group in groups] == [[0, 2], [1]]
    assert [group.plan.substeps for group in groups] == [max(one[0].plan.substeps for one in alone)] * 2
    assert len({one[0].plan.substeps for one in alone}) == 3


def test_a_batch_that_does_not_fit_is_refused_before_anything_is_made(tmp_path: Path, meshes: list[Path], monkeypatch):
    """The memory check counts all groups, the exported worlds and the table: in each case the rest alone would fit."""
    varied = {"balloon.0.mesh": meshes * 20}
    one_mesh, two_meshes = (
        sum(model.world_count * bytes_of_worlds(model) for model in (lay_out(group.plan, "cpu") for group in groups))
        for groups in (plan_groups(scene(), 40, {}), plan_groups(scene(), 40, varied))
    )
    sums = 40 * (2 * 32 * 40 + 4 * 7)  # 32 lanes of each balloon, seven measures
    row = 40 * 4 * 8  # of the table: seven measures and the health
    rest = sums + (FRAMES + 1) * row
    exported = 40 * 5 * (12 * (56 + 8) + 12)  # on the device, and four frames under way

    def refused(usable: float, needed: int, scene: Scene, **arguments: Any) -> None:
        assert usable < needed
        monkeypatch.setattr(memory, "free_memory", lambda device: int(usable / memory.USABLE))
        with pytest.raises(InputError, match=r"^40 worlds do not fit: ") as refusal:
            run_batch(scene, tmp_path / "out", 40, device="cpu", **arguments)
        fitting = int(str(refusal.value).split()[-2])
        assert fitting == pytest.approx(40 * usable / needed, abs=1)  # rounded down
        assert list(tmp_path.iterdir()) == []

    refused(0.6 * (two_meshes + rest), two_meshes + rest, scene(), vary=varied)
    refused(one_mesh + rest, one_mesh + rest + exported, scene(), export=range(40))
    refused(one_mesh + rest, one_mesh + rest + 1000 * row, scene(frames=FRAMES + 1000))
