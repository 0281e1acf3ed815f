"""Time codes that are not frames: stages of another rate, range or sampling than ours."""

from pathlib import Path

import numpy as np
import pytest
from meshes import cube
from pxr import Gf, Usd, UsdGeom

from balloon_warp import Balloon, InputError, Obstacle, Scene
from balloon_warp.model import plan_model
from balloon_warp.model.obstacle_motion import obstacle_motion
from balloon_warp.outputs.exports.parts import Animation

SECONDS = np.arange(25) / 24.0


def moving(path: Path, codes: np.ndarray, rate: float, where: np.ndarray = SECONDS, **told: float) -> Path:
    """Return a cube that moves along x, at these codes by these distances [m]: a meter a second by default."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    mesh = UsdGeom.Mesh.Define(stage, "/cube")
    mesh.CreatePointsAttr(cube().points)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(cube().face_vertex_indices)
    move = mesh.AddTranslateOp()
    for code, place in zip(codes.tolist(), where.tolist(), strict=True):
        move.Set(Gf.Vec3d(place, 0.0, 0.0), code)
    for name, value in told.items():
        stage.SetMetadata(name, value)
    stage.GetRootLayer().Save()
    return path


def times_and_places(path: Path) -> tuple[list[float], list[float]]:
    """Return the seconds of the frames, and the place of the cube's first corner in each."""
    animation = Animation(path)
    (part,) = animation.parts
    frames = list(animation.frames)
    return [animation.seconds(frame) for frame in frames], [float(part.points(frame)[0, 0]) for frame in frames]


@pytest.mark.parametrize(
    ("codes", "rate", "told"),
    [
        (24.0 * SECONDS, 24.0, {}),  # no range
        (1001.0 + 24.0 * SECONDS, 24.0, {"startTimeCode": 1001.0, "endTimeCode": 1025.0}),
        (1.0 * SECONDS, 1.0, {"startTimeCode": 0.0, "endTimeCode": 1.0}),  # seconds
        (4800.0 * SECONDS, 4800.0, {"startTimeCode": 0.0, "endTimeCode": 4800.0}),
        (24.0 * SECONDS, 24.0, {"startTimeCode": -1e7, "endTimeCode": 2e7}),  # wider than the samples
        (24.0 * SECONDS, 24.0, {"startTimeCode": 500.0, "endTimeCode": 600.0}),  # of other samples
        (0.5 + 24.0 * SECONDS, 24.0, {}),  # between codes
        (7.3 + 100.0 * SECONDS, 100.0, {}),
    ],
)
def test_frames_are_the_samples_own_times(tmp_path: Path, codes: np.ndarray, rate: float, told: dict[str, float]):
    times, places = times_and_places(moving(tmp_path / "cube.usda", codes, rate, **told))
    np.testing.assert_allclose(times, SECONDS, atol=1e-9)
    np.testing.assert_allclose(places, SECONDS, atol=1e-6)  # samples are shifted by a millionth of a frame


def test_a_range_narrower_than_the_samples_bounds_them(tmp_path: Path):
    path = moving(tmp_path / "cube.usda", 24.0 * SECONDS, 24.0, startTimeCode=6.0, endTimeCode=18.0)
    times, places = times_and_places(path)
    np.testing.assert_allclose(times, SECONDS[:13], atol=1e-9)
    np.testing.assert_allclose(places, SECONDS[6:19], atol=1e-9)


def test_where_nothing_moves_there_is_one_frame(tmp_path: Path):
    path = moving(tmp_path / "cube.usda", SECONDS[:1], 24.0, SECONDS[:1], startTimeCode=-1e7, endTimeCode=2e7)
    assert times_and_places(path) == ([0.0], [0.0])


def test_keyframes_far_apart_are_shown_at_the_rate_that_the_stage_says(tmp_path: Path):
    """Two keyframes, a second apart, are sampled at the stage's rate, in seconds and in 4,800 codes a second."""
    for rate in (1.0, 4800.0):
        told = {"where": np.array([0.0, 1.0]), "framesPerSecond": 24.0}
        path = moving(tmp_path / f"{rate:g}.usda", np.array([0.0, rate]), rate, **told)
        times, places = times_and_places(path)
        np.testing.assert_allclose(times, SECONDS, atol=1e-9)
        np.testing.assert_allclose(places, SECONDS, atol=1e-6)


@pytest.mark.parametrize("rate", [0.0, -24.0])
def test_time_that_does_not_run_is_refused(tmp_path: Path, rate: float):
    path = moving(tmp_path / "cube.usda", 24.0 * SECONDS, rate)
    sentence = rf"cube\.usda: its timeCodesPerSecond is {rate:g}; expected a rate above 0$"
    with pytest.raises(InputError, match=sentence):
        Animation(path)
    scene = Scene(balloon=[Balloon(mesh=cube(), position=(0.0, 9.0, 0.0))], obstacle=[Obstacle(mesh=path)])
    with pytest.raises(InputError, match=sentence):
        plan_model(scene)


def test_an_obstacle_moves_within_the_range_of_its_stage(tmp_path: Path):
    path = moving(tmp_path / "cube.usda", 4800.0 * SECONDS, 4800.0, startTimeCode=1200.0, endTimeCode=3600.0)
    scene = Scene(balloon=[Balloon(mesh=cube(), position=(0.0, 9.0, 0.0))], obstacle=[Obstacle(mesh=path)])
    along = obstacle_motion(scene)[:, 0, 0]
    np.testing.assert_allclose(along[[0, 15, 30]], [0.25, 0.5, 0.75], atol=1e-9)
    assert along.max() == pytest.approx(0.75)
