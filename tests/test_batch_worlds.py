"""Worlds that differ, by which values, and those that blow up beside others."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from commands import lines_executed
from feature_sets import feature_set
from meshes import cube, mesh_of, quad_sphere
from numpy.typing import NDArray
from pxr import Gf, Usd

from balloon_warp import BlowUpError, Cluster, InputError, Simulator, animate, load_scene, repeat_batch, simulate
from balloon_warp.batch.batch import BatchSummary, Range, parse_export, parse_vary, run_batch, spread
from balloon_warp.batch.recorder import Recorder, plan_groups
from balloon_warp.blow_ups import with_half_the_step
from balloon_warp.farm import cluster
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import ModelPlan, plan_model
from balloon_warp.scene import Balloon, Change, Ground, Inflation, Scene, Sphere, Stiffness, String

RAMPED = Balloon(mesh=quad_sphere(3), helium=3.0, inflation=Inflation(k_normal=[(0.0, 0.5), (0.05, 1.0), (0.1, 2.0)]))
LATE = Balloon(mesh=cube(), position=(3.0, 0.0, 0.0), inflation=Inflation(k_normal=[(0.0, 0.1), (0.05, 0.4)]))
FALLING = Sphere(position=(-3.0, -0.75, 0.0), velocity=(0.0, -1.0, 0.0), radius=0.3)
EVERYTHING = Scene(
    balloon=[RAMPED, LATE],
    sphere=[Sphere(position=(0.3, 1.1, 0.1), radius=0.4), Sphere(position=(3.5, 1.2, 0.5), radius=0.3), FALLING],
    string=[String(anchor=(0.0, -2.0, 0.0), length=0.5)],
    ground=Ground(height=-1.1),
    **{"frames": 4, "frames_per_second": 30, "substeps": 40},
)
"""a scene where every varied value matters: a sphere on the balloon, a taut string, ramped inflation"""


def test_a_recorder_of_places_and_turns_writes_within_its_arrays(monkeypatch: pytest.MonkeyPatch):
    """Both are picked in one graph: what stands behind the places stays, from the first frame on."""
    simulator = Simulator(feature_set("bodies"), "cpu", 2, schedule="gather")
    shape = (2, simulator.model.particle_count)
    for _ in range(2):  # once all kernels are compiled, too
        room = wp.full(3 * shape[0] * shape[1] + 8, 7.25, dtype=float, device="cpu")
        recorder = Recorder(simulator, np.array([0, 1]))
        picked = wp.array(ptr=room.ptr, shape=shape, dtype=wp.vec3, device="cpu")
        monkeypatch.setattr(recorder, "_points", picked)
        for _ in recorder.run():
            np.testing.assert_array_equal(room.numpy()[-8:], 7.25)
        np.testing.assert_array_equal(picked.numpy(), simulator.state.points.numpy())
        simulator.reset()


def test_strings_of_no_said_length_reach_from_each_worlds_anchor_to_its_balloon():
    strings = [String(anchor=(0.0, -2.0, 0.0)), String(anchor=(1, 0, 0), length=0.5)]
    scene = EVERYTHING.model_copy(update={"string": strings})
    heights, anchors = np.array([0.0, 0.4, 1.0]), np.array([0.0, 0.3, 0.0])
    plan = plan_model(scene, 3, {"balloon.0.position.1": heights, "string.0.anchor.0": anchors})
    lengths = plan.parameters["string_length"]
    for world in range(3):
        held = quad_sphere(3).points[plan.held[0]] + [0.0, heights[world], 0.0]
        assert lengths[world, 0] == pytest.approx(np.linalg.norm(held - [anchors[world], -2.0, 0.0]), rel=1e-12)
    np.testing.assert_array_equal(lengths[:, 1], 0.5)


@pytest.mark.parametrize("particle", ["highest", "lowest"])
def test_a_string_holds_the_same_particle_in_all_worlds(particle: str):
    """The next tip of an octahedron on its tip is as high once it has turned by 45 degrees."""
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    tied = String(anchor=(0.0, 3.0, 0.0), particle=particle)
    scene = Scene(balloon=[Balloon(mesh=mesh_of([*np.eye(3), *-np.eye(3)], faces))], string=[tied])
    plan_model(scene, 2, {"balloon.rotation.2": [0.0, 40.0]})
    with pytest.raises(InputError, match=f"in world 1 string 0 would hold another particle, which is the {particle}"):
        plan_model(scene, 2, {"balloon.rotation.2": [0.0, 50.0]})


@pytest.mark.parametrize(
    ("vary", "complaint"),
    [
        ({"balloon.mass": [1.0, 1.0, -1.0, 1.0]}, r"balloon\.0\.mass: must be .* 0 \(got -1\.0\), in world 2$"),
        ({"balloon.mass": [1.0, 2.0]}, r"balloon\.mass: expected a value for each of 4 worlds \(got shape \(2,\)\)$"),
        ({"sphere.5.mass": [1.0] * 4}, r"sphere\.5\.mass: no sphere 5, the scene has 3, counted from 0$"),
        ({"frames": [1] * 4}, r"frames: cannot differ .*; what can: gravity, corr.*, .*ground.*string\.length"),
        ({"balloon.1.position.2": [0, 1, 0, 1e6]}, r"mesh: is 1 m across and 1e\+06 m from the origin, too far"),
    ],
)
def test_a_wrong_value_is_told_in_a_sentence(vary: dict, complaint: str):
    with pytest.raises(InputError, match=f"^{complaint}"):
        plan_model(EVERYTHING, 4, vary)


def test_many_worlds_are_planned_without_a_loop_over_them():
    draw = np.random.default_rng(0).uniform(0.1, 1.0, 65_536)
    paths = ["balloon.mass", "balloon.stiffness.shear", "balloon.inflation.k_normal", "sphere.0.position.1"]
    scene = EVERYTHING.model_copy(update={"substeps": "auto"})

    def plan_worlds(count: int) -> ModelPlan:
        return plan_model(scene, count, dict.fromkeys(paths, draw[:count]))

    plan = plan_worlds(len(draw))
    assert lines_executed(lambda: plan_worlds(len(draw))) <= 1.1 * lines_executed(lambda: plan_worlds(16))
    np.testing.assert_array_equal(plan.parameters["mass"], np.stack([draw, draw], axis=1))
    assert plan.parameters["helium"].shape == (1, 2)


BALL = Scene(frames=3, substeps=8, balloon=[Balloon(mesh=quad_sphere(2), mass=1.0)])
OF_MODELS = {
    "balloon.stiffness.variation": [0.0, 0.5, 0.5, 0.5],
    "balloon.0.stiffness.seed": np.array([0, 1, 2, 1]),
    "balloon.scale": [1.0, 1.0, 1.0, 2.0],
    "gravity": [1.0, 2.0, 3.0, 4.0],
}


def test_each_world_is_as_it_is_alone():
    found = simulate(BALL, world_count=4, vary=OF_MODELS, device="cpu", schedule="octets")
    for world in range(4):
        own = {path: values[world] for path, values in OF_MODELS.items()}
        alone = simulate(load_scene(BALL, own), device="cpu", schedule="octets")
        np.testing.assert_array_equal(found.points[0][world], alone.points[0])
    assert len({points.tobytes() for points in found.points[0][:, -1]}) == 4


def test_what_is_wrong_is_told_with_its_world():
    for path, values, sentence in [
        ("balloon.stiffness.variation", [1.0, 2.0], r"balloon\.0\.stiffness\.variation: must be .* 1 \(got 2\.0\), in"),
        ("balloon.scale", [1.0], r"balloon\.scale: expected a number for each of 2 worlds \(got 1\)$"),
    ]:
        with pytest.raises(InputError, match=f"^{sentence}"):
            plan_groups(BALL, 2, {path: values})
    with pytest.raises(InputError, match=r"^balloon\.scale: needs a model for each world; batches and `simulate`"):
        Simulator(BALL, "cpu", 2, {"balloon.scale": [1.0, 2.0]})


@pytest.mark.parametrize(
    ("text", "parsed"),
    [
        ("balloon.inflation.k_normal=0:8", ("balloon.inflation.k_normal", Range(0.0, 8.0))),
        (" sphere.0.mass = 1, 10,1e2", ("sphere.0.mass", [1.0, 10.0, 100.0])),
        ("gravity=-9.81", ("gravity", [-9.81])),
        ("gravity=-3:-1.5", ("gravity", Range(-3.0, -1.5))),
    ],
)
def test_ranges_and_lists_are_read(text: str, parsed: tuple):
    assert parse_vary(text) == parsed


@pytest.mark.parametrize(
    "text",
    [
        *("gravity", "gravity=", "=1:2", "a..b=1", "gravity=1:", "gravity=2:1", "gravity=1:1"),
        *("gravity=a", "gravity=1:2:3", "gravity=1,,2", "gravity=nan", "gravity=0:inf"),
    ],
)
def test_what_is_neither_is_told(text: str):
    with pytest.raises(InputError, match=r"--vary .*: expected PATH=LOW:HIGH with LOW below HIGH, or PATH=NUMBER,"):
        parse_vary(text)


def test_meshes_are_sought_here_and_beside_the_scene(tmp_path, monkeypatch):
    (here := tmp_path / "here").mkdir()
    (here / "a.obj").touch()
    monkeypatch.chdir(here)
    _, meshes = parse_vary("balloon.mesh=a.obj,b.obj", str(tmp_path / "scene.toml"))
    assert meshes == ["a.obj", str(tmp_path / "b.obj")]
    _, bundled = parse_vary("balloon.mesh=turtle.obj", "squirrel_inflate")
    assert isinstance(bundled, list)
    assert Path(str(bundled[0])).is_file()


def test_lists_are_cycled_and_a_grid_is_even_with_its_ends_and_the_first_range_fastest():
    np.testing.assert_array_equal(spread({"a": [1.0, 10.0, 100.0]}, 5)["a"], [1.0, 10.0, 100.0, 1.0, 10.0])
    grid = spread({"a": Range(0.0, 2.0), "b": Range(5.0, 6.0), "c": [1.0, 2.0]}, 6, grid=True)
    np.testing.assert_equal(grid, {"a": [0, 1, 2, 0, 1, 2], "b": [5, 5, 5, 6, 6, 6], "c": [1, 2, 1, 2, 1, 2]})


def test_samples_are_uniform_and_go_by_seed_path_and_world():
    """Mean and spread of 10,000 samples are within four standard errors, and depend on no other path's samples."""
    samples = spread({"a": Range(2.0, 8.0)}, 10_000, seed=3)["a"]
    assert 2.0 <= np.min(samples) < np.max(samples) < 8.0
    assert np.mean(samples) == pytest.approx(5.0, abs=4 * 6.0 / np.sqrt(12 * 10_000))
    assert np.var(samples) == pytest.approx(3.0, abs=4 * 9.0 * np.sqrt(1 / 180 / 10_000) * 4)
    fewer = spread({"b": Range(0.0, 1.0), "a": Range(2.0, 8.0)}, 10, seed=3)
    np.testing.assert_array_equal(fewer["a"], samples[:10])
    assert not np.array_equal(6.0 * np.array(fewer["b"]) + 2.0, fewer["a"])
    assert not np.array_equal(spread({"a": Range(2.0, 8.0)}, 10, seed=4)["a"], samples[:10])


@pytest.mark.parametrize(
    ("ranges", "worlds", "sides"),
    [(1, 7, [7]), (2, 4096, [64, 64]), (2, 10, [3, 3]), (2, 12, [4, 3]), (3, 65_536, [40, 40, 40]), (2, 1, [1, 1])],
)
def test_a_grid_has_about_as_many_points_on_each_range_as_fit(ranges: int, worlds: int, sides: list[int]):
    grid = spread({str(n): Range(0.0, 1.0) for n in range(ranges)}, worlds, grid=True)
    assert [len(np.unique(values)) for values in grid.values()] == sides
    points = np.stack([np.array(values) for values in grid.values()], axis=1)
    count = int(np.prod(sides))
    assert len(np.unique(points[:count], axis=0)) == count
    np.testing.assert_array_equal(points[count:], points[: worlds - count])


def test_exports_are_all_none_or_chosen_worlds():
    assert parse_export("all", 3) == [0, 1, 2]
    assert parse_export("none", 3) == []
    assert parse_export("5, 0,5", 6) == [0, 5]
    with pytest.raises(InputError, match=r"^export 0,6: no world 6, the batch has worlds 0 to 5$"):
        parse_export("0,6", 6)
    with pytest.raises(InputError, match=r"^export first: expected all, none, or worlds such as 0,5,9$"):
        parse_export("first", 6)


PAIR = [Balloon(mesh=cube()), Balloon(mesh=quad_sphere(3), position=(5.0, 0.0, 0.0))]
TWO = Scene(frames=5, frames_per_second=50.0, balloon=PAIR, sphere=[Sphere(position=(0.0, 4.0, 0.0))])


@pytest.mark.full
def test_arrays_hold_what_the_frames_hold():
    found = simulate(TWO, device="cpu")
    np.testing.assert_allclose(found.times, [0.0, 0.02, 0.04, 0.06, 0.08, 0.1], rtol=1e-12)
    assert [points.shape for points in found.points] == [(6, 8, 3), (6, 56, 3)]
    for frame in Simulator(TWO, "cpu").run():
        for name in ("points", "velocities"):
            np.testing.assert_equal([each[frame.number] for each in getattr(found, name)], list(getattr(frame, name)))
        for name in ("pressures", "gas_amounts", "sphere_positions", "sphere_velocities"):
            np.testing.assert_array_equal(getattr(found, name)[frame.number], getattr(frame, name))
        for name in ("volumes", "areas"):  # NumPy adds in an order that hangs on where the numbers lie
            np.testing.assert_allclose(getattr(found, name)[frame.number], getattr(frame, name), rtol=1e-14)
    assert repr(found) == "Trajectories(mesh of 8 particles, mesh of 56 particles; 6 frames, 0 to 0.1 s)"


@pytest.mark.full
def test_worlds_come_first_and_frames_may_be_left_out():
    """A sphere falls by g t^2 / 2 in each world's gravity, to the first order of the step: v is a step ahead."""
    gravity = np.array([1.0, 2.0, 9.81])
    found = simulate(TWO, {"frames": 6}, world_count=3, vary={"gravity": gravity}, every=3, device="cpu")
    np.testing.assert_allclose(found.times, [0.0, 0.06, 0.12])
    assert found.points[1].shape == (3, 3, 56, 3)
    assert found.volumes.shape == found.pressures.shape == (3, 3, 2)
    fallen = 4.0 - found.sphere_positions[:, :, 0, 1]
    substep = 0.02 / Simulator(TWO, "cpu").model.substeps
    exact = 0.5 * gravity[:, None] * found.times * (found.times + substep)
    np.testing.assert_allclose(fallen, exact, atol=2e-6)  # float32 at 4 m


@pytest.mark.full
def test_what_cannot_be_told_is_refused():
    with pytest.raises(InputError, match=r"^vary: meshes of different sizes need separate trajectories"):
        simulate(TWO, world_count=2, vary={"balloon.0.mesh": [cube(), quad_sphere(3)]}, device="cpu")
    with pytest.raises(InputError, match=r"^every: must be at least 1 \(got 0\)$"):
        simulate(TWO, every=0, device="cpu")
    with pytest.raises(InputError, match=r"^1 worlds do not fit: they need "):
        simulate(TWO, {"frames": 10**9}, device="cpu")
    with pytest.raises(BlowUpError):
        simulate(TWO, {"solver": "forward_euler", "substeps": 1, "balloon.mass": 1e-4, "frames": 60}, device="cpu")


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
FAR_SPHERE = Sphere(position=(0, 4, 0))
HOPELESS = Scene(balloon=[Balloon(mesh=cube(), inflation=BURSTS)], sphere=[FAR_SPHERE], frames=12, faces=False)
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
