"""Bundled scenes of contact: nothing tunnels through anything, and balloons roll, are pressed, tied and squeezed."""

from pathlib import Path

import numpy as np
import pytest
from played import most_held, played, shape_at
from scipy.spatial.transform import Rotation

import balloon_warp.scenes
from balloon_warp import Frame, load_scene, run_batch
from balloon_warp.benchmarks.overlap import deepest_in_itself, deepest_overlap
from balloon_warp.mesh.surface_nets import MeshDistance
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.model import Model
from balloon_warp.model.touch import APART
from balloon_warp.scenes.model_bead import RADIUS
from balloon_warp.scenes.model_knot import CELL
from balloon_warp.scenes.model_knot import RADIUS as TUBE
from balloon_warp.scenes.pit import HALF, main, scene

ROUNDING = 2e-5
"""float32's, of points on a surface a meter from the origin [m]"""


def test_the_script_makes_the_pit_and_smaller_ones_with_their_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = Path(balloon_warp.scenes.__path__[0]) / "balloon_pit.toml"
    assert file.read_text(encoding="utf-8") == scene()
    main([str(tmp_path / "pit.toml"), "--columns", "2", "--layers", "3"])
    assert len(load_scene(tmp_path / "pit.toml").balloon) == 12
    said = capsys.readouterr().out.splitlines()
    assert said == [f"wrote {tmp_path / 'bead.obj'}", f"wrote {tmp_path / 'pit.toml'}: 12 balloons"]


@pytest.mark.parametrize("words", ["mesh.obj", "nowhere/pit.toml", "pit.toml --columns 0"])
def test_the_script_refuses_what_makes_no_pit(tmp_path, monkeypatch, capsys, words: str):
    monkeypatch.chdir(tmp_path)
    Path("mesh.obj").write_text("mine")
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == 2
    assert "error: " in capsys.readouterr().err
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]


def test_a_hundred_balloons_keep_out_of_each_other_and_of_the_box():
    """Overlap stays below a fiftieth of the radius, while the balloons fall and settle, and after the ball lands, from
    2 s on. How many it drives out of the box is chaotic: 88 and 92 stay in two schedules; all would without it."""
    model, frames = played("balloon_pit")
    halves = [np.array(obstacle.size) for obstacle in model.obstacles]
    meshes = [shape.mesh for shape in model.shapes]
    for frame in frames[40:161:40]:
        points = np.concatenate(frame.points).astype(np.float64)
        assert deepest_overlap([part.astype(np.float64) for part in frame.points], meshes) < 0.02 * RADIUS
        for half, pose in zip(halves, frame.obstacle_poses, strict=True):
            assert (np.abs(points - pose[:3]) - half).max(axis=1).min() > -ROUNDING
    centers = np.array([part.mean(axis=0) for part in frames[160].points])
    inside = (np.abs(centers[:, [0, 2]]) < HALF).all(axis=1)
    assert 80 <= inside.sum() < 100
    assert (centers[:, 1] > -0.12 + 0.5 * RADIUS).all()
    heights = [float(frame.sphere_positions[0, 1]) for frame in frames]
    assert 0.2 < heights[150] < 0.7 < heights[120]  # it lies among them, on others
    assert heights[160] > 0.2 - ROUNDING  # or on the floor, to which it sinks at about that time


def test_a_batch_counts_what_stays_in_the_box(tmp_path: Path):
    """The count differs by one between two worlds, in one of which a balloon starts a meter higher, above the box."""
    short = load_scene("balloon_pit", {"frames": 3})
    run_batch(short, tmp_path, 2, {"balloon.0.position.1": [0.13, 1.6]}, device="cpu", schedule="gather")
    with np.load(tmp_path / "table.npz") as table:
        counts = table["in_box"].reshape(4, 2)
    low = (np.array([balloon.position for balloon in short.balloon])[:, 1] < 1.0 - RADIUS).sum()
    assert (counts == [[low, low - 1]] * 4).all()


def test_a_long_balloon_ties_itself_and_keeps_out_of_itself():
    """A strand that tunneled through another would untie the knot."""
    model, frames = played("knot")
    mesh = model.shapes[0].mesh
    for number in (36, 60, 90, 130, 170):
        points = frames[number].points[0].astype(np.float64)
        assert deepest_in_itself(points, mesh, APART * CELL) < 0.02 * TUBE
    assert most_held("knot") > 30
    points = frames[170].points[0]
    assert np.ptp(points[:, 0]) > 1.5 * np.ptp(mesh.points[:, 0])  # pulled out
    middle = points[np.abs(points[:, 0] - points[:, 0].mean()) < 0.2]
    assert np.ptp(middle[:, 1]) > 4.0 * TUBE  # three strands of the knot on each other


def test_a_balloon_slips_through_the_slot():
    model, frames = played("letter_slot")
    plate = model.obstacles[0]
    assert plate.mesh
    distance, thick = MeshDistance(plate.mesh.points, plate.triangles, thickness=0.0), np.ptp(plate.mesh.points[:, 1])
    seen = []
    for frame in frames[::10]:
        seen.append(seen_from(frame, 0, 0))
        assert distance(seen[-1]).min() > -ROUNDING
    assert seen[0][:, 1].max() < 0.0
    assert seen[-1][:, 1].min() > thick
    widths = [np.ptp(frame.points[0][:, 0]) for frame in frames]
    assert max(widths) > 1.15 * 0.28  # the hole
    inside = [points[(points[:, 1] > 0.1 * thick) & (points[:, 1] < 0.9 * thick)] for points in seen]
    assert max(np.abs(points[:, [0, 2]]).max() for points in inside if len(points)) < 0.14 + ROUNDING
    volumes = [signed_volume(shape_at(model, frame)) for frame in (frames[60], frames[-1])]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.02)


def seen_from(frame: Frame, number: int, balloon: int) -> np.ndarray:
    """Return a balloon's points in the frame of an obstacle."""
    pose = frame.obstacle_poses[number]
    return Rotation.from_quat(pose[3:]).inv().apply(frame.points[balloon].astype(np.float64) - pose[:3])


def box_distances(model: Model, frame: Frame, number: int) -> np.ndarray:
    beyond = np.abs(seen_from(frame, number, 0)) - model.obstacles[number].size
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def test_no_balloon_goes_through_the_table():
    model, frames = played("table")
    table = model.obstacles[0]
    assert table.mesh
    distance = MeshDistance(table.mesh.points, table.triangles, thickness=0.0)
    for frame in frames[::5]:
        for balloon in range(4):
            assert distance(seen_from(frame, 0, balloon)).min() > -ROUNDING


def test_balloons_roll_off_the_table():
    model, frames = played("table")
    heights = np.array([[points[:, 1].mean() for points in frame.points] for frame in frames])
    off = (heights < 0.5).argmax(axis=0)  # well below the top
    order = np.argsort([-shape.mesh.points[:, 0].mean() for shape in model.shapes])
    assert (off > 0).all()
    assert (np.diff(off[order]) > 0).all()
    for balloon in range(4):
        begin, end = (frames[number].points[balloon].astype(np.float64) for number in (90, 120))
        way = np.linalg.norm(end.mean(axis=0) - begin.mean(axis=0))
        turn = Rotation.align_vectors(end - end.mean(axis=0), begin - begin.mean(axis=0))[0].as_rotvec()
        radius = np.linalg.norm(end - end.mean(axis=0), axis=1).mean()
        assert -turn[2] * radius == pytest.approx(way, rel=1 / 3)


def test_the_press_squeezes_and_lets_go():
    model, frames = played("press")
    for frame in frames:
        assert min(box_distances(model, frame, number).min() for number in (0, 1)) > -ROUNDING
    before, squeezed, after = (frames[number] for number in (12, 80, 209))
    tops = [frame.points[0][:, 1].max() for frame in (before, squeezed, after)]
    assert tops[1] == pytest.approx(1.12 - 0.56 - 0.04, abs=1e-4)
    assert min(tops[0], tops[2]) > 1.5 * tops[1]
    depths = [np.ptp(frame.points[0][:, 2]) for frame in (before, squeezed)]
    assert depths[1] > 1.2 * depths[0]
    volumes = [signed_volume(shape_at(model, frame)) for frame in (squeezed, after)]
    assert volumes[1] > 1.1 * volumes[0]
