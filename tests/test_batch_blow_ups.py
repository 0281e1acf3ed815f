"""Worlds of a batch that blow up, and their neighbors; and a run that blows up."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import cube
from numpy.typing import NDArray
from pxr import Gf, Usd

from balloon_warp import BlowUpError, Cluster, InputError, animate, load_scene, repeat_batch
from balloon_warp.batch.batch import BatchSummary, run_batch
from balloon_warp.blow_ups import with_half_the_step
from balloon_warp.farm import cluster
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene import Balloon, Change, Ground, Inflation, Scene, Sphere, Stiffness, String

FRAMES, WORLDS = 6, 9
BAD, LAST_GOOD = 3, 3  # the world that blows up, and its last good frame
FLOATING = Balloon(mesh=cube(), position=(0.0, 2.0, 0.0), damping=0.0, inflation=Inflation(k_normal=0.2))
AROUND: dict[str, Any] = {"sphere": [Sphere(position=(0.2, 5.0, 0.0), radius=0.5)], "ground": Ground()}
AROUND["string"] = [String(anchor=(0.0, 0.0, 0.0), stiffness=1.0)]
FLOATS = Scene(balloon=[FLOATING], **AROUND, frames=FRAMES, frames_per_second=30.0, faces=False)
ASTRAY = 1.5e9
"""lift [N/kg]: 1/2 a t^2 passes 1e7 m, the farthest that a balloon of a meter may be, between frames 3 and 4"""
LIFTS = np.linspace(5.0, 12.0, WORLDS)
SCHEDULES = {schedule: (FLOATS, schedule) for schedule in ("scatter", "gather", "octets", "lanes", "block")}
WAYS = SCHEDULES | {"projective": (FLOATS.model_copy(update={"solver": "projective"}), "auto")}

HELD: dict[str, Any] = {"string": [String(anchor=(0, -1, 0))], "solver": "forward_euler", "substeps": 3, "frames": 40}
BOX = Balloon(mesh=cube(), mass=1.0, damping=50.0, inflation=Inflation(k_normal=0.2))
GAINS_ENERGY = Scene(balloon=[BOX], sphere=[Sphere(position=(0.0, 4.0, 0.0))], **HELD)
VARY = {"balloon.stiffness.structural": [100, 3000, 100, 3000, 1400, 100], "balloon.helium": [0, 0, 0, 0, 0, 9e9]}
EXPORT = [1, 2, 4, 5]
SUBSTEPS = {1: 12, 3: 12, 4: 6}
"""with which forward Euler takes the stiffer worlds to the end; the last one flies away in any case"""


def table(folder: Path) -> dict[str, NDArray]:
    """Return the table's columns, of shape (frame, world)."""
    with np.load(folder / "table.npz") as columns:
        worlds = int(columns["world"].max()) + 1
        return {name: columns[name].reshape(-1, worlds) for name in columns}


def rows(folder: Path) -> list[list[str]]:
    """Return each world's lines of the table, without its number."""
    worlds: dict[str, list[str]] = {}
    for line in (folder / "table.csv").read_text().splitlines()[1:]:
        world, _, row = line.partition(",")
        worlds.setdefault(world, []).append(row)
    return list(worlds.values())


def assert_same_files(ours: Path, theirs: Path, *names: str) -> None:
    for name in ("table.csv", "table.npz", *names):
        assert (ours / name).read_bytes() == (theirs / name).read_bytes()


def samples(file: Path, root: str = "/") -> dict[str, NDArray[np.float64]]:
    """Return the numbers of a stage that change with time, by attribute path below a prim and time."""
    stage, found = Usd.Stage.Open(str(file)), {}
    for prim in Usd.PrimRange(stage.GetPrimAtPath(root)):
        for attribute in prim.GetAttributes():
            for time in attribute.GetTimeSamples():
                value = attribute.Get(time)
                if isinstance(value, Gf.Quatf):
                    value = (value.GetReal(), *value.GetImaginary())
                if not isinstance(value, str):
                    path = attribute.GetPath().MakeRelativePath(root)
                    found[f"{path} {time:g}"] = np.array(value, dtype=np.float64)
    return found


def of_world(folder: Path, world: int) -> dict[str, NDArray[np.float64]]:
    return samples(folder / "worlds.usdc", f"/World/World_{world}")


def assert_finite(folder: Path, exported: Sequence[int]) -> None:
    assert all(np.isfinite(column).all() for column in table(folder).values())
    assert np.isfinite(np.loadtxt(folder / "table.csv", delimiter=",", skiprows=1)).all()
    for world in exported:
        found = of_world(folder, world)
        kinds = {path.partition(" ")[0].rpartition(".")[2] for path in found}
        assert {"points", "velocities", "extent", "xformOp:translate"} <= kinds
        assert all(np.isfinite(value).all() for value in found.values())


@pytest.fixture(params=WAYS)
def way(request, device: str) -> tuple[Scene, str]:
    if device != "cpu" and request.param in ("octets", "lanes", "scatter"):
        pytest.skip("simulates on the CPU, or does not repeat on a GPU")
    return WAYS[request.param]


@pytest.mark.full
def test_a_frozen_world_is_marked_and_the_others_are_as_if_it_were_not_there(way, device: str, tmp_path):
    scene, schedule = way
    lifts = np.insert(LIFTS, BAD, ASTRAY)
    with_it, without = tmp_path / "with", tmp_path / "without"
    options: dict[str, Any] = {"device": device, "schedule": schedule}
    summary = run_batch(scene, with_it, WORLDS + 1, {"balloon.helium": lifts}, export=range(WORLDS + 1), **options)
    run_batch(scene, without, WORLDS, {"balloon.helium": LIFTS}, export=range(WORLDS), **options)
    assert_finite(with_it, range(WORLDS + 1))
    others = [world for world in range(WORLDS + 1) if world != BAD]
    assert [rows(with_it)[world] for world in others] == rows(without)
    for alone, world in enumerate(others):
        np.testing.assert_equal(of_world(with_it, world), of_world(without, alone))

    assert (summary.unhealthy_worlds, summary.restarted_worlds, len(summary.blow_ups)) == (1, 0, 1)
    assert f"blew up in frame {LAST_GOOD + 1}, world {BAD}" in summary.blow_ups[0]
    columns = table(with_it)
    assert columns["health"][:, BAD].tolist() == [1] * (LAST_GOOD + 1) + [0] * (FRAMES - LAST_GOOD)
    for name, column in columns.items():
        if name not in ("frame", "time", "health"):
            assert (column[LAST_GOOD:, BAD] == column[LAST_GOOD, BAD]).all()
    assert len(set(columns["center_height"][:, BAD].tolist())) == LAST_GOOD + 1
    found = of_world(with_it, BAD)
    for path, value in found.items():
        attribute, _, time = path.partition(" ")
        if float(time) > LAST_GOOD:
            still = attribute.endswith("velocities")
            np.testing.assert_array_equal(value, 0.0 if still else found[f"{attribute} {LAST_GOOD}"])


def batch(folder: Path, on_blowup: str, **options: Any) -> BatchSummary:
    """Run a batch of worlds that blow up, and two that do not."""
    return run_batch(GAINS_ENERGY, folder, 6, VARY, export=EXPORT, on_blowup=on_blowup, **options)


@pytest.mark.parametrize("schedule", ["gather", "lanes", "block"], indirect=True)
def test_restarted_worlds_are_those_of_a_batch_in_shorter_steps(schedule: str, device: str, tmp_path):
    options, restarted = {"device": device, "schedule": schedule}, tmp_path / "restarted"
    summary = batch(restarted, "restart", **options)
    assert (summary.unhealthy_worlds, summary.restarted_worlds) == (1, len(SUBSTEPS))
    assert [sentence.partition("world ")[2][0] for sentence in summary.blow_ups] == ["1", "3", "4"]
    assert_finite(restarted, EXPORT)
    found = rows(restarted)
    for substeps in (3, 6, 12):
        folder = tmp_path / str(substeps)
        run_batch(load_scene(GAINS_ENERGY, {"substeps": substeps}), folder, 6, VARY, export=EXPORT, **options)
        expected = rows(folder)
        for world in (world for world in range(5) if SUBSTEPS.get(world, 3) == substeps):
            health = 2 if world in SUBSTEPS else 1
            assert found[world] == [row.rpartition(",")[0] + f",{health}" for row in expected[world]]
            if world in EXPORT:
                np.testing.assert_equal(of_world(restarted, world), of_world(folder, world))
    assert table(restarted)["health"][[0, -1]].tolist() == [[1, 2, 1, 2, 2, 2], [1, 2, 1, 2, 2, 0]]


@pytest.mark.full
def test_the_manifest_says_what_blew_up_and_repeats_it(tmp_path):
    write_obj(tmp_path / "cube.obj", cube())
    balloon = GAINS_ENERGY.balloon[0].model_copy(update={"mesh": tmp_path / "cube.obj"})
    scene = GAINS_ENERGY.model_copy(update={"balloon": [balloon]})
    run_batch(scene, tmp_path / "first", 6, VARY, on_blowup="restart", device="cpu")
    manifest = json.loads((tmp_path / "first" / "manifest.json").read_text())
    assert manifest["on_blowup"] == "restart"
    assert manifest["restarted_worlds"] == {str(world): substeps for world, substeps in SUBSTEPS.items()}
    assert [report["world"] for report in manifest["blow_ups"]] == [1, 3, 4]
    assert manifest["blow_ups"][0]["sentence"].startswith("the simulation blew up in frame 16, world 1, substep ")
    assert manifest["blow_ups"][0]["spring"]["stretch"] > 1e3
    repeat_batch(tmp_path / "first" / "manifest.json", tmp_path / "again")
    assert_same_files(tmp_path / "first", tmp_path / "again")


@pytest.mark.full
def test_a_batch_that_is_stopped_while_worlds_begin_again_goes_on_to_the_same_files(tmp_path):
    notes: list[str] = []

    def stop(sentence: str) -> None:
        notes.append(sentence)
        if "restarting" in sentence:
            raise KeyboardInterrupt

    batch(tmp_path / "expected", "restart", device="cpu")
    with pytest.raises(KeyboardInterrupt):
        batch(tmp_path / "stopped", "restart", device="cpu", checkpoint_seconds=1e-9, on_note=stop)
    assert notes == ["4 of 6 worlds blew up: restarting them with half the step"]
    assert batch(tmp_path / "stopped", "restart", device="cpu", resume=True).restarted_worlds == len(SUBSTEPS)
    assert_same_files(tmp_path / "stopped", tmp_path / "expected", "worlds.usdc")


@pytest.mark.full
@pytest.mark.parametrize("workers", [None, 2])
def test_to_stop_leaves_nothing(workers: int | None, tmp_path):
    where: dict[str, Any] = {"cluster": Cluster(workers=workers)} if workers else {"device": "cpu"}
    with pytest.raises(BlowUpError, match=r"blew up in frame \d+, world [1345], "):
        batch(tmp_path / "stopped", "stop", **where)
    assert list((tmp_path / "stopped").iterdir()) == []


def test_another_policy_is_refused(tmp_path):
    runs = [lambda: batch(tmp_path / "a", "pray"), lambda: animate(HOPELESS, tmp_path / "a.usdc", on_blowup="pray")]
    for run in runs:
        with pytest.raises(InputError, match=r"^on_blowup pray: expected freeze, stop, restart$"):
            run()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.full
def test_a_cluster_restarts_what_one_process_does(monkeypatch, tmp_path):
    monkeypatch.setitem(cluster.GRAIN, "cpu", cluster.Grain(1, 1))  # a share for each world
    alone = batch(tmp_path / "alone", "restart", device="cpu")
    together = batch(tmp_path / "together", "restart", cluster=Cluster(workers=2))
    assert together.blow_ups == alone.blow_ups
    assert (together.unhealthy_worlds, together.restarted_worlds) == (1, len(SUBSTEPS))
    assert_same_files(tmp_path / "alone", tmp_path / "together")
    folders = tmp_path / "alone", tmp_path / "together"
    np.testing.assert_equal(*(samples(folder / "worlds.usdc") for folder in folders))
    kept = [json.loads((folder / "manifest.json").read_text())["restarted_worlds"] for folder in folders]
    assert kept[0] == kept[1]


BURSTS = Inflation(k_normal=[(0.0, 1.0), (0.1, 1.0), (0.15, 9e11)])  # stronger than any step is short, from frame 7 on
BALL = Sphere(position=(0, 4, 0))
HOPELESS = Scene(balloon=[Balloon(mesh=cube(), inflation=BURSTS)], sphere=[BALL], frames=12, faces=False)
STIFF = Balloon(mesh=cube(), mass=1.0, damping=50.0, stiffness=Stiffness(structural=3000.0))
RESTARTS = Scene(balloon=[STIFF], **HELD)  # too long a step for forward Euler, and its half, but not a quarter of it


@pytest.mark.full
def test_frozen_the_stage_ends_at_the_last_good_frame(device: str, tmp_path):
    warnings: list[str] = []
    how = {"device": device, "schedule": "gather", "checkpoint_seconds": 1e-9}
    summary = animate(HOPELESS, tmp_path / "a.usdc", on_blowup="freeze", on_warning=warnings.append, **how)
    assert [path.name for path in tmp_path.iterdir()] == ["a.usdc"]  # the states saved meanwhile are in it
    assert summary.frames == 6
    assert "blew up in frame 7, " in (summary.blow_up or "")
    assert warnings[-1].rpartition(". ")[2] == "The stage ends at frame 6, the last good one"
    assert Usd.Stage.Open(str(tmp_path / "a.usdc")).GetEndTimeCode() == 6
    found = samples(tmp_path / "a.usdc")
    assert all(np.isfinite(value).all() for value in found.values())
    assert {float(key.split()[-1]) for key in found} == set(range(7))
    animate(load_scene(HOPELESS, {"frames": 6}), tmp_path / "b.usdc", device=device, schedule="gather")
    np.testing.assert_equal(found, samples(tmp_path / "b.usdc"))


@pytest.mark.full
def test_restarted_it_is_the_run_with_as_many_substeps_byte_by_byte(device: str, tmp_path):
    warnings: list[str] = []
    how = {"device": device, "schedule": "gather"}  # which is deterministic
    restarted, expected = tmp_path / "restarted.usdc", tmp_path / "expected.usdc"
    summary = animate(RESTARTS, restarted, on_blowup="restart", on_warning=warnings.append, **how)
    assert (summary.restarts, summary.substeps, summary.frames, summary.blow_up) == (2, 12, 40, None)
    said = [sentence.rpartition(". ")[2] for sentence in warnings]
    assert said == [f"It restarts with {substeps} substeps a frame" for substeps in (6, 12)]
    assert animate(load_scene(RESTARTS, {"substeps": 12}), expected, **how).restarts == 0
    assert restarted.read_bytes() == expected.read_bytes()
    with pytest.raises(BlowUpError):
        animate(load_scene(RESTARTS, {"substeps": 6}), tmp_path / "longer.usdc", **how)


@pytest.mark.full
def test_stopped_in_shorter_steps_it_goes_on_in_these(device: str, tmp_path):
    frames: list[int] = []

    def stop(frame: int) -> None:
        frames.append(frame)
        if frames.count(5) == 3:
            raise RuntimeError("stopped")

    how = {"device": device, "schedule": "gather", "on_blowup": "restart"}
    animate(RESTARTS, tmp_path / "whole.usdc", **how)
    with pytest.raises(RuntimeError, match="stopped"):
        animate(RESTARTS, tmp_path / "out.usdc", checkpoint_seconds=1e-9, on_frame=stop, **how)
    assert not (tmp_path / "out.usdc.partial.old").exists()
    summary = animate(RESTARTS, tmp_path / "out.usdc", resume=True, **how)
    assert (summary.begin, summary.restarts, summary.substeps) == (4, 2, 12)
    assert (tmp_path / "out.usdc").read_bytes() == (tmp_path / "whole.usdc").read_bytes()


@pytest.mark.full
@pytest.mark.parametrize(
    ("on_blowup", "said"), [("stop", "less force helps"), ("restart", "The 4 longer steps blew up as well")]
)
def test_where_it_ends_in_a_blow_up_the_old_stage_stays(on_blowup: str, said: str, tmp_path):
    (tmp_path / "a.usdc").write_text("old")
    with pytest.raises(BlowUpError, match=said):
        animate(HOPELESS, tmp_path / "a.usdc", device="cpu", on_blowup=on_blowup)
    assert [path.name for path in tmp_path.iterdir()] == ["a.usdc"]
    assert (tmp_path / "a.usdc").read_text() == "old"


def test_half_the_step_holds_for_what_the_scene_changes_it_to():
    settings = [{"substeps": 20, "gravity": 1.0}, {"substeps": "auto"}, {"gravity": 2.0}]
    changes = [Change(time=0.1 * (number + 1), set=each) for number, each in enumerate(settings)]
    halved = with_half_the_step(RESTARTS.model_copy(update={"change": changes}), 7)
    assert halved.substeps == 14
    assert [change.set for change in halved.change] == [{**settings[0], "substeps": 40}, *settings[1:]]
