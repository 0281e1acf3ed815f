"""Bundled scenes show the effects for which they are there: of contact, rubber and foil, and the paper's methods."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.spatial.transform import Rotation
from trajectories import most_held, played, shape_at, stretches

import balloon_warp.scenes
from balloon_warp import Frame, PolygonMesh, load_scene
from balloon_warp.benchmarks.overlap import deepest_in_itself, deepest_overlap
from balloon_warp.mesh.surface_nets import MeshDistance
from balloon_warp.mesh.topology import mesh_edges, signed_volume, total_area
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


def latex_pressure(mesh: PolygonMesh, stretch: float) -> float:
    """Return A h W' / (3 V l^2) of Mooney-Rivlin rubber [Pa]."""
    mu, ratio = 3.3e5, 0.1
    rising = (1.0 / stretch - stretch**-7.0) * (1.0 + ratio * stretch**2) / (1.0 + ratio)
    return 2.0 * mu * 2e-4 * total_area(mesh) / (3.0 * signed_volume(mesh)) * rising


def test_latex_inflate_shows_that_blowing_is_hardest_at_the_start():
    """Each has a Mooney-Rivlin sphere's pressure; the largest's falls until a stretch of 3.1. In the end the smallest
    has most."""
    model, frames = played("latex_inflate")
    mesh = model.shapes[2].mesh

    def stretch_at(frame: Frame, balloon: int) -> float:
        return float(np.cbrt(signed_volume(shape_at(model, frame, balloon)) / signed_volume(mesh)))

    for balloon in range(3):
        pressure, expected = frames[-1].pressures[balloon], latex_pressure(mesh, stretch_at(frames[-1], balloon))
        assert pressure == pytest.approx(expected, rel=0.01)
    assert frames[-1].pressures[0] > 1.1 * max(frames[-1].pressures[1:])
    curve = np.array([(stretch_at(frame, 2), frame.pressures[2]) for frame in frames if frame.number <= 48])
    lowest = curve[10 + curve[10:, 1].argmin(), 0]
    assert 2.9 < lowest < 3.4
    assert curve[:10, 1].max() > 1.1 * curve[10:, 1].min()
    assert curve[-1, 1] > 1.01 * curve[10:, 1].min()


def test_foil_letters_fill_without_stretching():
    """Edges are no longer than their film is, but for twice the bound on its strain; and each stays upright: the O does
    not fold."""
    model, frames = played("foil_letters")
    assert model.balloon_count == 5
    for letter in range(5):
        flat, full = (shape_at(model, frame, letter) for frame in (frames[0], frames[-1]))
        assert signed_volume(full) > 15.0 * signed_volume(flat)
        edges = mesh_edges(flat).ends
        lengths, rest = (np.linalg.norm(np.diff(mesh.points[edges], axis=1), axis=2) for mesh in (full, flat))
        assert (lengths / rest).max() < 1.006
        across = np.linalg.svd(full.points - full.points.mean(axis=0), compute_uv=False)[-1]
        assert across < 0.35 * 0.1 * np.sqrt(len(full.points))


def test_rocket_balloon_is_driven_by_its_jet_and_loops():
    """Flight goes more than 2 m up, turns over, and ends nearly empty."""
    model, frames = played("rocket_balloon")
    centers = np.array([frame.points[0].mean(axis=0) for frame in frames])
    assert centers[:, 1].max() > centers[48, 1] + 2.0
    neck, top = (int(pick(model.shapes[0].mesh.points[:, 1])) for pick in (np.argmin, np.argmax))
    upright = [np.sign((frame.points[0][top] - frame.points[0][neck])[1]) for frame in frames[48:]]
    assert min(upright) < 0.0 < max(upright)
    assert frames[-1].volumes[0] < 0.1 * frames[48].volumes[0]


def test_two_latex_balloons_end_at_the_two_roots_of_one_pressure():
    """Rubber beyond its peak bears less the larger it is: the smaller one empties. Each is within 1 %."""
    model, frames = played("two_latex_balloons")
    mesh = model.shapes[0].mesh
    volume, pressure_at = signed_volume(mesh), partial(latex_pressure, mesh)

    def moles_at(stretch: float) -> float:
        return (101325.0 + pressure_at(stretch)) * volume * stretch**3 / (8.314462618 * 293.15)

    before, end = frames[60], frames[-1]
    peak = minimize_scalar(lambda stretch: -pressure_at(stretch), bounds=(1.1, 2.0), method="bounded").x
    lowest = minimize_scalar(pressure_at, bounds=(2.0, 4.0), method="bounded").x

    def smaller(larger: float) -> float:
        return float(brentq(lambda stretch: pressure_at(stretch) - pressure_at(larger), 1.01, peak))  # type: ignore[arg-type]

    total = before.gas_amounts.sum()
    larger = brentq(lambda stretch: moles_at(stretch) + moles_at(smaller(stretch)) - total, peak + 0.1, lowest)
    found = np.cbrt([signed_volume(shape_at(model, end, number)) / volume for number in (0, 1)])
    np.testing.assert_allclose(found, [smaller(larger), larger], rtol=0.01)
    np.testing.assert_allclose(end.pressures, pressure_at(larger), rtol=0.01)
    np.testing.assert_allclose(end.gas_amounts, [moles_at(smaller(larger)), moles_at(larger)], rtol=0.03)
    assert before.pressures[0] > 1.1 * before.pressures[1]  # so that it flows from the smaller
    assert end.volumes[0] < 0.4 * before.volumes[0]


def test_with_correction_the_shape_is_a_scaled_copy():
    """The paper did not want that: at equal volume, without correction, the stretch varies twice as much."""
    strong = (
        *(("correction", "provot"), ("correction_limit", 0.25), ("frames", 110)),
        ("balloon.inflation.k_normal", ((0.2, 0.0), (1.7, 28.0))),
    )
    (model, plain), (_, corrected) = played("squirrel_inflate"), played("squirrel_inflate", strong)
    rest = signed_volume(shape_at(model, plain[0]))
    volumes = [signed_volume(shape_at(model, frames[-1])) for frames in (plain, corrected)]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.1)
    spread = [np.ptp(np.percentile(stretches(model, frames[-1]), [10, 90])) for frames in (plain, corrected)]
    assert spread[1] < 0.5 * spread[0]
    assert volumes[1] == pytest.approx(1.25**3 * rest, rel=0.1)
    gentle = (("correction", "provot"), ("correction_limit", 0.1), ("frames", 120))  # the same inflation as without
    _, held = played("squirrel_inflate", gentle)
    assert signed_volume(shape_at(model, held[-1])) == pytest.approx(1.1**3 * rest, rel=0.05)
    assert np.ptp(np.percentile(stretches(model, held[-1]), [10, 90])) < 0.5 * spread[0]


def apart(first: np.ndarray, second: np.ndarray) -> float:
    """Return the root-mean-square distance of two shapes after alignment [m]."""
    first, second = (points.astype(np.float64) - points.mean(axis=0) for points in (first, second))
    return Rotation.align_vectors(second, first)[1] / len(first) ** 0.5


def test_stiff_springs_on_a_coarse_model_come_close_to_correction():
    """Springs twice as stiff leave less than half the distance to the corrected shape: the paper's squirrel."""
    stiff = tuple(
        (f"balloon.stiffness.{kind}", k) for kind, k in (("structural", 200), ("shear", 100), ("flexion", 10))
    )
    correction = (("correction", "provot"), ("correction_limit", 0.1))
    plain, stiffer, corrected = (
        played("squirrel_inflate", (*overrides, ("frames", 120)))[1][-1].points[0]
        for overrides in ((), stiff, correction)
    )
    assert apart(stiffer, corrected) < 0.5 * apart(plain, corrected)


def test_correction_constrains_a_strongly_inflated_balloon_most():
    volumes = {}
    for k_normal in (1.0, 14.0):
        inflation = (("frames", 110), ("balloon.inflation.k_normal", ((0.2, 0.0), (1.7, k_normal))))
        for correction in ("none", "provot"):
            model, frames = played("squirrel_inflate", (("correction", correction), *inflation))
            volumes[k_normal, correction] = signed_volume(shape_at(model, frames[-1]))
    assert volumes[1.0, "provot"] == pytest.approx(volumes[1.0, "none"], rel=0.01)
    assert volumes[14.0, "provot"] < 0.5 * volumes[14.0, "none"]


def test_tarantinos_correction_is_smoother_than_provots():
    """The paper says so: of the hundredth that changes its velocity the most from frame to frame, at the limit, the
    change is less, by 8% on the ground, by 9% in free air without gravity, by 14% on ice. A twentieth is asked. The
    balloon is larger by less than 2%, as springs pull less near their limit."""
    jolts, volumes = [], []
    for correction in ("provot", "tarantino"):
        held = (("correction", correction), ("correction_limit", 0.1), ("frames", 120))
        model, frames = played("squirrel_inflate", held)
        velocities = np.array([frame.velocities[0] for frame in frames[60:]])
        changes = np.linalg.norm(np.diff(velocities, axis=0), axis=-1)
        jolts.append(np.percentile(changes, 99, axis=1).mean())
        volumes.append(signed_volume(shape_at(model, frames[-1])))
    assert jolts[1] < 0.95 * jolts[0]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.02)


def test_cached_normals_give_the_shape_of_fresh_ones():
    """The paper says so. In the last half second volumes agree to three thousandths: those with cached normals jitter,
    and of seven starts a micrometer apart their means were 162.55 to 162.80 liters, where with fresh ones they were
    162.75 to 162.78."""
    model, fresh = played("squirrel_inflate")
    _, cached = played("squirrel_inflate", (("normals", "cached"),))
    volume = [np.mean([frame.volumes[0] for frame in frames[-30:]]) for frames in (fresh, cached)]
    np.testing.assert_allclose(volume[1], volume[0], rtol=3e-3)
    springs = model.shapes[0].springs
    lengths = [
        np.linalg.norm(np.diff(frames[-1].points[0][springs.pairs], axis=1), axis=-1).ravel()
        for frames in (fresh, cached)
    ]
    assert abs(lengths[1] / lengths[0] - 1.0).mean() < 0.01
    assert (lengths[0] / springs.rest_lengths).mean() > 1.1


def turned_by(rest: np.ndarray, points: np.ndarray, up: tuple[float, float, float]) -> float:
    """Return the angle [degrees] by which the best-fitting rotation turns the up axis."""
    rotation = Rotation.align_vectors(points - points.mean(axis=0), rest - rest.mean(axis=0))[0]
    return float(np.degrees(np.arccos(np.clip(rotation.apply(up) @ up, -1.0, 1.0))))


def test_squirrel_tether_floats_upright_and_still_above_its_anchor():
    """The string is at its length at the start, and straight at the end, stretched by the lift; after five seconds
    nothing moves by more than some millimeters a second."""
    model, frames = played("squirrel_tether")
    string, balloon, end = model.scene.string[0], model.scene.balloon[0], frames[-1]
    points = end.points[0].astype(np.float64)
    assert turned_by(model.shapes[0].mesh.points, points, model.scene.up) < 5.0
    np.testing.assert_allclose(points.mean(axis=0)[[0, 2]], 0.0, atol=0.01)
    assert np.linalg.norm(end.velocities[0], axis=1).max() < 0.005
    length = float(model.parameters["string_length"].numpy()[0, 0])
    held = model.string_particle.numpy()[0]
    reach = [float(np.linalg.norm(frame.points[0][held] - string.anchor)) for frame in (frames[0], end)]
    assert reach[0] == pytest.approx(length, rel=1e-6)
    lift = balloon.mass * (balloon.helium - model.scene.gravity)
    assert reach[1] - length == pytest.approx(lift / string.stiffness, rel=0.01)
    rest = model.shapes[0].mesh
    assert 1.2 < signed_volume(shape_at(model, end)) / signed_volume(rest) < 1.35  # full, with its face


PAPERS_TETHER = (
    ("balloon.inflation.k_normal", ((0.0, 2.0), (1.0, 8.0))),
    ("balloon.stiffness.thin", "alike"),
    ("string.anchor", (-0.3, 0.6, 0.0)),
    ("string.particle", "highest"),
    ("string.length", 1.0),
)
"""the paper's inflation, and the string at the very end of the tail"""


def test_squirrel_tether_turns_from_upright_to_upside_down():
    """The squirrel turns over in the frames of figures 19 to 21, and hangs so to the end, above a taut string."""
    model, frames = played("squirrel_tether", PAPERS_TETHER)
    places = [frames[number].points[0].astype(np.float64) for number in (0, 80, 300, -1)]
    turned = [turned_by(model.shapes[0].mesh.points, each, model.scene.up) for each in places]
    assert turned[0] < 1.0
    assert 45.0 < turned[1] < 100.0
    assert min(turned[2:]) > 120.0
    string, points = model.scene.string[0], places[-1]
    held = points[model.string_particle.numpy()[0]]
    assert string.length is not None
    assert np.linalg.norm(held - string.anchor) > string.length
    assert held[1] < points[:, 1].min() + 0.1
    assert points[:, 1].mean() > held[1] + 0.5
