"""Picture files, their views and frames, cameras in each world, kept pictures, and messages where none can be made."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import cube
from meshes import quad_sphere as sphere_of_quads
from PIL import Image
from pxr import Gf, Usd, UsdGeom
from render_stages import (
    add_camera,
    add_curves,
    add_ground,
    add_mesh,
    add_sphere,
    new_stage,
    quad_sphere,
    small_world,
    upright,
)
from render_stages import read_stage as read

from balloon_warp import Balloon, Body, Ground, InputError, MissingExtraError, Scene, Simulator, Sphere, render_stage
from balloon_warp.cli.options import parse_frames, parse_place
from balloon_warp.scene import Inflation, Material, Obstacle, bundled_scenes, load_scene
from balloon_warp.scenes.gallery import MOVING, MOVING_SIZE
from balloon_warp.steering.observations import WorldCamera
from balloon_warp.studio.render.render import _choose_frames
from balloon_warp.studio.render.stage_reader import RenderStage
from balloon_warp.studio.render.view import View
from balloon_warp.system.files import whole_file
from balloon_warp.usd.studio import Camera

SMALL: dict[str, Any] = {"size": (64, 36), "samples": 1, "device": "cpu"}


@pytest.fixture
def stage(tmp_path) -> Path:
    """Return a stage of a ball that crosses the picture in 48 frames, 2 s."""
    path = tmp_path / "stage.usda"
    made = new_stage(path, frames=48)
    add_sphere(made, "Ball", [(0.1 * frame, 0.0, 0.0) for frame in range(48)], 0.5, (0.8, 0.1, 0.1))
    made.GetRootLayer().Save()
    return path


def test_png_has_the_size_asked_for(stage: Path, tmp_path):
    assert render_stage(stage, tmp_path / "a.png", **SMALL) == [47]
    with Image.open(tmp_path / "a.png") as picture:
        assert (picture.format, picture.size, picture.mode) == ("PNG", (64, 36), "RGB")


@pytest.mark.parametrize(
    ("data", "shown"),
    [({"pictureFrame": 12}, 12), *((data, 47) for data in ("text", *({"pictureFrame": n} for n in ("soon", 0.5, 48))))],
)
def test_the_stage_names_its_picture(stage: Path, tmp_path, data: object, shown: int):
    opened = Usd.Stage.Open(str(stage))
    opened.GetRootLayer().customLayerData = {"balloonWarp": data}
    opened.GetRootLayer().Save()
    assert render_stage(stage, tmp_path / "a.png", **SMALL) == [shown]
    assert render_stage(stage, tmp_path / "a.png", frame=3, **SMALL) == [3]


def test_gif_takes_as_long_as_the_stage(stage: Path, tmp_path):
    done = []
    frames = render_stage(stage, tmp_path / "a.gif", on_frame=lambda *both: done.append(both), **SMALL)
    # 24 frames a second are more than the 20 that a GIF gets: every other one.
    assert frames == list(range(0, 48, 2))
    assert done == [(number, 24) for number in range(1, 25)]
    with Image.open(tmp_path / "a.gif") as animation:
        assert animation.size == (64, 36)
        durations, places = [], []
        for number in range(getattr(animation, "n_frames")):  # noqa: B009 (only some of Pillow's formats have it)
            animation.seek(number)
            durations.append(animation.info["duration"])
            red = np.asarray(animation.convert("RGB")).astype(int)
            places.append(np.nonzero(red[..., 0] - red[..., 1] > 60)[1].mean())
    assert len(durations) == 24
    # A GIF counts in hundredths of a second: 8 for 2 frames of 1/24 s, 8.33.
    assert sum(durations) == pytest.approx(2000, abs=100)
    assert (np.diff(places) > 0.0).all(), "the ball goes one way"


def test_mp4_has_every_frame(stage: Path, tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="needs the extra `video`")
    render_stage(stage, tmp_path / "a.mp4", **SMALL)
    count, seconds = ffmpeg.count_frames_and_secs(str(tmp_path / "a.mp4"))
    assert (count, seconds) == (48, pytest.approx(2.0, abs=0.05))


def test_mp4_without_ffmpeg_names_the_extra(stage: Path, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'balloon-warp\[video\]'"):
        render_stage(stage, tmp_path / "a.mp4", **SMALL)


def test_a_write_that_fails_in_usd_gets_a_sentence(tmp_path):
    with pytest.raises(InputError, match=r"a\.usda: cannot be written: "), whole_file(tmp_path / "a.usda"):
        Usd.Stage.Open(str(tmp_path / "none.usda"))  # raises one of USD's own exceptions
    assert list(tmp_path.iterdir()) == []


def test_names_may_be_long_and_errors_of_other_files_are_not_blamed_on_the_output(stage: Path, tmp_path):
    output = tmp_path / ("x" * 251 + ".png")  # 255 bytes, the most that file systems take
    render_stage(stage, output, **SMALL)
    assert output.stat().st_size > 0
    with pytest.raises(FileNotFoundError), whole_file(tmp_path / "a.png"):
        (tmp_path / "none").read_bytes()


@pytest.mark.parametrize(
    ("output", "options", "sentence"),
    [
        ("a.jpg", {}, r"a\.jpg: cannot write \.jpg; expected \.png, \.webp, \.gif, \.mp4"),
        ("none/a.png", {}, "none does not exist"),
        ("a.png", {"frame": 48}, r"frame: 48 is not in .*stage\.usda; expected 0 to 47"),
        ("a.gif", {"frame": 3}, r"frame: 3 for a \.gif, which shows all frames; expected a \.png"),
        ("a.png", {"samples": 0}, "samples: 0 rays a pixel; expected at least 1"),
        ("a.png", {"elevation": -1.0}, "elevation: -1 degrees; expected 0 to 90"),
        ("a.png", {"size": (0, 10)}, "size: a picture of 0x10 pixels; expected at least 1x1"),
        ("a.png", {"samples": 10**9}, "samples: 1000000000 rays a pixel; expected at most 4096"),
        ("x" * 252 + ".png", {}, "cannot be written: File name too long"),
        ("a:SDF_FORMAT_ARGS:b.png", {}, "expected a name without it"),
        ("a.png", {"device": "cuda:99"}, "cuda:99: no such device; this machine has cpu"),
        ("a.png", {"zoom": 0.0}, "zoom: 0; expected 0.01 to 100"),
        ("a.png", {"look_at": "nobody"}, "look-at: 'nobody' is not visible in .*; visible are .*Ball"),
        ("a.png", {"look_at": "bal"}, r"look-at: 'bal' is not visible in .*; did you mean Ball\?"),
        ("a.png", {"look_at": (1.0, 2.0, 3.0), "follow": True}, "follow: a point does not move"),
        ("a.png", {"aperture": -1.0}, "aperture: -1; expected the lens's diameter, 0 or more"),
        ("a.png", {"focus": "Ball"}, "focus: needs an aperture"),
        ("a.png", {"shutter": 1.5}, "shutter: 1.5; expected 0 to 1 of a frame"),
        ("a.gif", {"transparent": True}, r"transparent: a\.gif has no transparency; expected \.png or \.webp"),
        ("a.gif", {"frames": (5, 99)}, "frames: 5:99 is not in .*; expected a range in 0:47"),
        ("a.gif", {"frames_per_second": 0.0}, r"fps: 0; expected 0\.01 to 1000"),
        ("a.png", {"frames": (1, 3)}, "one picture has no frames and no rate"),
    ],
)
def test_bad_requests_get_a_sentence(stage: Path, tmp_path, output: str, options: dict, sentence: str):
    with pytest.raises(InputError, match=sentence):
        render_stage(stage, tmp_path / output, **SMALL | options)
    assert [path.name for path in tmp_path.iterdir()] == ["stage.usda"]


BALL = quad_sphere(2)


def fewer_points_later(made: Usd.Stage) -> None:
    ball = add_mesh(made, "Bad", *BALL, (1, 0, 0))
    ball.GetPointsAttr().Set(BALL[0].astype(np.float32), 0)
    ball.GetPointsAttr().Set(BALL[0][:5].astype(np.float32), 2)


def ground_alone(made: Usd.Stage) -> None:
    made.RemovePrim("/World/Ball")
    add_ground(made)


@pytest.mark.parametrize(("text", "sentence"), [(None, "no such file; expected"), ("hello", "cannot be read as")])
def test_no_stage_gets_a_sentence(text: str | None, sentence: str, tmp_path):
    if text:
        (tmp_path / "a.usda").write_text(text)
    with pytest.raises(InputError, match=rf"a\.usda: {sentence} a USD stage"):
        render_stage(tmp_path / "a.usda", tmp_path / "a.png", **SMALL)


def test_other_peoples_stages(tmp_path):
    corners = [(0, 0, 0), (2, 0, 0), (2, 0, 2), (0, 0, 2), (1, 2, 1)]
    seen = []
    for name, unused in (("tidy", []), ("untidy", [(9, 9, 9)])):
        made = Usd.Stage.CreateNew(str(tmp_path / f"{name}.usda"))
        mesh = UsdGeom.Mesh.Define(made, "/pyramid")
        mesh.CreatePointsAttr(np.array([*corners, *unused], np.float32))
        mesh.CreateFaceVertexCountsAttr([4, 3, 3, 3, 3])
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 1, 0, 4, 2, 1, 4, 3, 2, 4, 0, 3, 4])
        made.GetRootLayer().Save()
        render_stage(tmp_path / f"{name}.usda", tmp_path / "a.png", **SMALL)
        seen.append(np.asarray(Image.open(tmp_path / "a.png")).astype(int))
    assert np.ptp(seen[0]) > 100
    assert (seen[0] == seen[1]).all()


@pytest.mark.parametrize(
    ("setting", "output", "sentence"),
    [
        ("timeCodesPerSecond = 0", "a.gif", "timeCodesPerSecond is 0; expected a rate above 0"),
        ("endTimeCode = inf", "a.png", "time codes go from 0 to inf; expected finite ones"),
        ("endTimeCode = -3", "a.png", "time codes go from 0 to -3; expected finite ones, in order"),
    ],
)
def test_impossible_times_get_a_sentence(setting: str, output: str, sentence: str, tmp_path):
    name = setting.split()[0]
    text = _ball_and(tmp_path).read_text().splitlines()
    (tmp_path / "b.usda").write_text("\n".join(f"    {setting}" if name in line else line for line in text))
    with pytest.raises(InputError, match=sentence):
        render_stage(tmp_path / "b.usda", tmp_path / output, **SMALL)


def test_a_range_without_a_whole_frame_shows_the_next(tmp_path):
    path = _ball_and(tmp_path)
    path.write_text(path.read_text().replace("startTimeCode = 0", "startTimeCode = 0.2"))
    path.write_text(path.read_text().replace("endTimeCode = 0", "endTimeCode = 0.7"))
    assert render_stage(path, tmp_path / "a.png", **SMALL) == [1]


@pytest.mark.parametrize(
    ("break_it", "sentence"),
    [
        (lambda made: add_camera(made, 5.0, 0.0), "at frame 0 has an aperture of .* focal length of 0; expected"),
        (lambda made: add_camera(made, 5.0, 50.0).AddScaleOp().Set(Gf.Vec3f(0.0)), "has a transform that is singular"),
        (lambda made: add_curves(made, "Lines", [(0, 0, 0)] * 3, [4, -1], 0.1, [(1, 0, 0)]), "a curve has -1 points"),
        (lambda made: add_curves(made, "Lines", [(0, 0, 0)] * 3, [4], 0.1, [(1, 0, 0)]), "has 3 points .* expected 4"),
        (lambda made: add_curves(made, "Lines", [(0, 0, 0)] * 2, [2], np.nan, [(1, 0, 0)]), "a width is negative or"),
        (lambda made: add_sphere(made, "Bad", (0, 0, 0), np.inf, (1, 0, 0)), "its center or radius at frame 0 is not"),
        (lambda made: add_mesh(made, "Bad", np.eye(3), [4, -1], [0, 1, 2], (1, 0, 0)), "its faces do not match its 3"),
        (
            lambda made: add_mesh(made, "Bad", np.where(BALL[0] > 0.9, np.nan, BALL[0]), *BALL[1:], (1, 0, 0)),
            "/World/Bad: a point at frame 0 is not finite",
        ),
        (fewer_points_later, "has 5 points at frame 2; expected 26 at every frame"),
        (ground_alone, r"ball\.usda: has no visible mesh, solid shape or linear curves to draw at frame 0"),
    ],
)
def test_impossible_stages_get_a_sentence(break_it: Callable[[Usd.Stage], object], sentence: str, tmp_path):
    path = _ball_and(tmp_path, break_it, frames=3)
    with pytest.raises(InputError, match=sentence):
        render_stage(path, tmp_path / "a.gif", **SMALL)


def test_usd_keeps_its_warnings_to_itself(tmp_path, capfd):
    path = _ball_and(tmp_path, lambda made: made.DefinePrim("/World/Gone").GetReferences().AddReference("./gone.usda"))
    capfd.readouterr()
    render_stage(path, tmp_path / "a.png", **SMALL)
    assert "gone" not in capfd.readouterr().err


def test_a_long_gif_has_at_most_120_pictures(tmp_path):
    path = tmp_path / "long.usda"
    made = new_stage(path, frames=1000)
    made.SetTimeCodesPerSecond(10)
    add_sphere(made, "Ball", (0, 0, 0), 1.0, (1, 0, 0))
    move = UsdGeom.Xformable(made.GetPrimAtPath("/World")).AddTranslateOp()
    for code in (0, 999):
        move.Set(Gf.Vec3d(0.001 * code, 0.0, 0.0), code)
    made.GetRootLayer().Save()
    frames = render_stage(path, tmp_path / "a.gif", size=(8, 8), samples=1, device="cpu")
    # 1000 / 120 = 8.3: every ninth frame.
    assert frames == list(range(0, 1000, 9))


def _ball_and(folder: Path, change: Callable[[Usd.Stage], object] = lambda made: None, frames: int = 1) -> Path:
    """Return a stage with a ball and something else."""
    made = new_stage(folder / "ball.usda", frames=frames)
    add_sphere(made, "Ball", (0, 0, 0), 1.0, (1, 0, 0))
    change(made)
    made.GetRootLayer().Save()
    return folder / "ball.usda"


FRAMES, RATE = 20, 40.0


@pytest.fixture(scope="module", params=["Y", "Z"])
def rise(request, tmp_path_factory) -> RenderStage:
    """Write a stage of a soft square of side 0.2 that rises by 10 in 20 frames, and a sphere that stays."""
    path = tmp_path_factory.mktemp("stage") / "rise.usda"
    made = new_stage(path, request.param, frames=FRAMES + 1)
    made.SetTimeCodesPerSecond(RATE)
    square = np.array([(-0.1, -0.1, 0.0), (0.1, -0.1, 0.0), (0.1, 0.1, 0.0), (-0.1, 0.1, 0.0)])
    soft = add_mesh(made, "soft", square, [4], [0, 1, 2, 3], (0.8, 0.1, 0.1))
    for frame in range(FRAMES + 1):
        points = upright(made, square + [0.0, 0.5 * frame, 0.0])
        soft.GetPointsAttr().Set(points, frame)
        soft.GetExtentAttr().Set([Gf.Vec3f(*map(float, point)) for point in points[[0, 2]]], frame)
    add_sphere(made, "ball", (3.0, 0.0, 0.0), 0.5, (0.1, 0.1, 0.8)).CreateExtentAttr([(-0.5,) * 3, (0.5,) * 3])
    made.Save()
    return read(path)


def seen(camera: Camera, point: tuple[float, float, float]) -> np.ndarray:
    """Return the place of a point in the picture, Y up: -1 to 1 each way."""
    x, y, z = camera.axes @ (np.array(point) - camera.eye)
    return np.array([x / -z / camera.half_width, y / -z / camera.half_height])


def cameras(rise: RenderStage, **how) -> list[Camera]:
    _, camera = View(**how).cameras(rise, list(range(FRAMES + 1)), 16 / 9)
    return [camera(frame) for frame in range(FRAMES + 1)]


def test_zoom_enlarges_and_what_is_named_is_in_the_middle(rise: RenderStage):
    once, twice = cameras(rise)[0], cameras(rise, zoom=2.0)[0]
    for point in ((3.0, 0.0, 0.0), (0.0, 5.0, 0.0)):
        np.testing.assert_allclose(seen(twice, point), 2.0 * seen(once, point), atol=1e-9)
    named = cameras(rise, look_at="ball")[FRAMES]
    np.testing.assert_allclose(seen(named, (3.0, 0.0, 0.0)), 0.0, atol=1e-6)
    point = cameras(rise, look_at=(1.0, 2.0, 3.0))[0]
    up = UsdGeom.GetStageUpAxis(rise.stage)
    np.testing.assert_allclose(seen(point, (1.0, 2.0, 3.0) if up == "Y" else (1.0, 3.0, -2.0)), 0.0, atol=1e-6)
    np.testing.assert_allclose(named.axes, cameras(rise)[0].axes)


@pytest.mark.parametrize("look_at", [None, "soft"])
def test_a_camera_that_follows_keeps_its_subject_large_and_in_the_middle(rise: RenderStage, look_at: str | None):
    for frame, camera in enumerate(cameras(rise, follow=True, look_at=look_at)):
        corners = np.array([seen(camera, (x, 0.5 * frame + y, 0.0)) for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
        assert np.abs(corners).max() < 0.9
        assert np.ptp(corners[:, 1]) > 1.2
    still = np.array([seen(cameras(rise)[0], (0.0, y, 0.0)) for y in (-0.1, 0.1)])
    assert np.ptp(still[:, 1]) < 0.1


def test_a_stage_says_from_where_its_picture_is_taken_unless_one_asks(rise: RenderStage, tmp_path):
    plain = cameras(rise)[0]
    said = {"azimuth": 70.0, "elevation": 40, "zoom": 3.0, "look_at": Gf.Vec3d(1.0, 2.0, 3.0)}
    rise.stage.GetRootLayer().customLayerData = {"balloonWarp": {"pictureView": said | {"other": 1.0}}}
    try:
        asked = cameras(rise, azimuth=70.0, elevation=40.0, zoom=3.0, look_at=(1.0, 2.0, 3.0))[0]
        as_said, turned, followed = cameras(rise)[0], cameras(rise, azimuth=10.0)[0], cameras(rise, follow=True)[0]
        np.testing.assert_allclose([as_said.eye, *as_said.axes], [asked.eye, *asked.axes])
        assert as_said.half_width == asked.half_width == turned.half_width
        assert not np.allclose(turned.axes, asked.axes)
        assert followed.half_width == plain.half_width
        for garbage in ("text", {"zoom": "large", "look_at": 3.0}):
            rise.stage.GetRootLayer().customLayerData = {"balloonWarp": {"pictureView": garbage}}
            np.testing.assert_array_equal(cameras(rise)[0].eye, plain.eye)
    finally:
        rise.stage.GetRootLayer().customLayerData = {}


def test_a_lens_is_focused_on_what_is_named(rise: RenderStage):
    inside = (1.0, 2.0, 3.0) if UsdGeom.GetStageUpAxis(rise.stage) == "Y" else (1.0, 3.0, -2.0)
    for named, place in (("ball", (3.0, 0.0, 0.0)), ((1.0, 2.0, 3.0), inside)):
        camera = cameras(rise, aperture=0.1, focus=named)[0]
        assert camera.aperture == 0.1
        assert camera.focus == pytest.approx((camera.eye - place) @ camera.axes[2])
    middle = cameras(rise, aperture=0.1, look_at="ball")[0]
    assert middle.focus == pytest.approx((middle.eye - [3.0, 0.0, 0.0]) @ middle.axes[2])


def test_frames_and_places_are_understood():
    assert parse_frames("10:90") == (10, 90)
    assert parse_frames(":90") == (None, 90)
    assert parse_place("squirrel") == "squirrel"
    assert parse_place("1,-2,.5") == (1.0, -2.0, 0.5)
    for parse, text in ((parse_frames, "10-90"), (parse_frames, "90"), (parse_place, "1,2"), (parse_place, "1,2,x")):
        with pytest.raises(InputError, match="expected"):
            parse(text)


def test_a_part_at_another_rate_keeps_its_speed(rise: RenderStage, tmp_path):
    how = {"size": (192, 108), "samples": 1, "frames": (4, None), "frames_per_second": 10.0}
    shown = render_stage(rise.path, tmp_path / "out.gif", **how)
    assert shown == [4, 8, 12, 16, 20]
    with Image.open(tmp_path / "out.gif") as picture:
        assert (picture.n_frames, picture.info["duration"]) == (5, 100)
    assert _choose_frames(rise, ".mp4", None, (None, 2), 80.0) == ([0, 0, 1, 2, 2], 1.0 / 80.0)

    shown = render_stage(rise.path, tmp_path / "a.webp", frames_per_second=RATE, **SMALL)
    assert shown == list(range(FRAMES + 1))
    with Image.open(tmp_path / "a.webp") as animation:
        assert (animation.format, animation.size) == ("WEBP", (64, 36))
        milliseconds = 0
        for number in range(animation.n_frames):  # of pictures that are the same, one is kept, as long as all of them
            animation.seek(number)
            animation.load()
            milliseconds += animation.info["duration"]
    assert milliseconds == (FRAMES + 1) * 1000 / RATE
    render_stage(rise.path, tmp_path / "one.webp", frames=(3, 3), **SMALL)
    with Image.open(tmp_path / "one.webp") as picture:
        assert getattr(picture, "n_frames", 1) == 1


STILL = Inflation(k_normal=0.0)
FAR_BALL = Balloon(mesh=sphere_of_quads(2, 0.1), position=(0.0, 0.0, 90.0), inflation=STILL)
"""Behind the camera, since a scene has a balloon"""
EYE, SIZE, ANGLE = (0.0, 0.0, 5.0), (33, 25), 40.0
RADIUS, CENTER = 0.8, np.array([0.3, -0.1, 0.5])


def scene(**fields: Any) -> Scene:
    fields = {"balloon": [FAR_BALL], "gravity": 0.0} | fields
    return Scene(frames=2, **fields)


def camera_of(simulator: Simulator, eye: Any = EYE, target: Any = (0.0, 0.0, 0.0)) -> WorldCamera:
    return simulator.observations.camera(eye, target, *SIZE, ANGLE)


def camera_in(of: Scene, *places: Any) -> WorldCamera:
    return camera_of(Simulator(of, "cpu"), *places)


def depths(of: Scene, *places: Any) -> np.ndarray:
    return camera_in(of, *places).depth.numpy()


def rays() -> np.ndarray:
    """Return rays that reach depth one, of a camera that looks along -z with y up, shape (height, width, 3)."""
    width, height = SIZE
    slope = np.tan(np.radians(ANGLE) / 2.0)
    x = slope * width / height * (2.0 * (np.arange(width) + 0.5) / width - 1.0)
    y = slope * (1.0 - 2.0 * (np.arange(height) + 0.5) / height)
    return np.stack([*np.meshgrid(x, y), -np.ones((height, width))], axis=-1)


def depths_of_sphere(center: np.ndarray = CENTER) -> np.ndarray:
    """Return where rays enter a sphere, by the quadratic formula."""
    toward, arm = rays(), center - EYE
    a, b, c = (toward**2).sum(axis=-1), toward @ arm, arm @ arm - RADIUS**2
    with np.errstate(invalid="ignore"):
        found = (b - np.sqrt(b * b - a * c)) / a
    return np.where(np.isnan(found), np.inf, found)


def ball(center: np.ndarray = CENTER, cells: int = 12) -> Balloon:
    return Balloon(mesh=sphere_of_quads(cells, RADIUS), position=tuple(center), inflation=STILL)


def test_a_sphere_is_as_far_as_the_formula_says(device: str):
    of = scene(sphere=[Sphere(position=tuple(CENTER), radius=RADIUS)])
    camera = camera_of(Simulator(of, device))
    assert camera.depth.shape == (1, SIZE[1], SIZE[0])
    told = depths_of_sphere()
    assert 0.1 < np.isfinite(told).mean() < 0.5
    np.testing.assert_allclose(camera.depth.numpy()[0], told, rtol=1e-5)


def test_a_balloon_is_as_far_as_its_sphere_and_has_no_gap(device: str):
    """Depth of a balloon is that of its sphere up to a chord's sagitta over the cosine of the viewing angle."""
    camera = camera_of(Simulator(scene(balloon=[ball()]), device))
    found, told = camera.depth.numpy()[0], depths_of_sphere()
    assert np.isinf(found[np.isinf(told)]).all()
    places = EYE + np.where(np.isinf(told), 0.0, told)[..., None] * rays()
    facing = -((places - CENTER) / RADIUS * rays()).sum(axis=-1) / np.linalg.norm(rays(), axis=-1)
    seen = np.isfinite(told) & (facing > 0.4)
    assert seen.mean() > 0.08
    sag = RADIUS * (1.0 - np.cos(np.pi / 4.0 / 12.0 * np.sqrt(2.0)))
    off = found[seen] - told[seen]
    assert off.min() > -1e-5
    assert (off <= 1.5 * sag / facing[seen]).all()


def test_each_world_is_seen_as_it_is_alone(device: str):
    path, places = "balloon.0.position.0", np.array([0.0, 0.4, -0.5])
    eyes = np.array([EYE, (0.0, 1.0, 4.0), (-1.0, 0.0, 6.0)])
    of = scene(balloon=[ball()], sphere=[Sphere(position=(0.9, 0.0, 1.0), radius=0.3)], ground=Ground(height=-1.0))
    together = camera_of(Simulator(of, device, 3, {path: places}), eyes)
    for world in range(3):
        camera = camera_of(Simulator(of, device, 1, {path: places[world : world + 1]}), eyes[world])
        np.testing.assert_array_equal(together.depth.numpy()[world], camera.depth.numpy()[0])
        np.testing.assert_array_equal(together.color.numpy()[world], camera.color.numpy()[0])
    assert (together.depth.numpy()[0] != together.depth.numpy()[1]).mean() > 0.2


def test_a_capsule_a_plane_and_the_ground_are_where_they_are():
    toward = rays()
    with np.errstate(divide="ignore"):
        told = np.where(toward[..., 1] < 0.0, -2.0 / toward[..., 1], np.inf)
    np.testing.assert_allclose(depths(scene(ground=Ground(height=-2.0)))[0], told, rtol=1e-5)
    lying = scene(obstacle=[Obstacle(radius=RADIUS, length=1.0, rotation=(90.0, 0.0, 0.0), position=(0.3, -0.1, 0.0))])
    np.testing.assert_allclose(depths(lying)[0], depths_of_sphere(), rtol=2e-5)
    plane = scene(obstacle=[Obstacle(shape="plane", position=(0.0, -2.0, 0.0))])
    np.testing.assert_allclose(depths(plane), depths(scene(ground=Ground(height=-2.0))), rtol=1e-5)


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_a_camera_may_look_straight_down(up_axis: str):
    eye = (0.0, 3.0, 0.0) if up_axis == "Y" else (0.0, 0.0, 3.0)
    camera = camera_in(scene(up_axis=up_axis, ground=Ground(height=-1.0)), eye)
    np.testing.assert_allclose(camera.depth.numpy(), 4.0, rtol=1e-5)
    assert np.ptp(camera.color.numpy(), axis=(1, 2)).max() <= 1


TURNED = {"position": tuple(CENTER), "rotation": (20.0, 30.0, 10.0)}


def test_a_box_is_seen_as_a_mesh_a_body_and_a_balloon_of_that_shape_are():
    mesh = replace(cube(), points=cube().points - 0.5)
    size = np.ptp(mesh.points, axis=0)
    told = depths(scene(obstacle=[Obstacle(size=tuple(size), **TURNED)]))
    assert 0.05 < np.isfinite(told).mean() < 0.95
    others = (
        scene(obstacle=[Obstacle(mesh=mesh, **TURNED)]),
        scene(body=[Body(size=tuple(size), **TURNED)]),
        scene(body=[Body(mesh=mesh, **TURNED)]),
        scene(balloon=[Balloon(mesh=mesh, inflation=STILL, **TURNED)]),
    )
    for other in others:
        np.testing.assert_allclose(depths(other), told, rtol=2e-5)


@pytest.mark.full
def test_frames_refresh_what_is_seen_and_cameras_move(device: str):
    moving = Obstacle(size=(0.5, 0.5, 0.5), position=(0.0, -1.4, 0.0), motion=[(0.0, (0, 0, 0)), (0.1, (0.5, 0, 0))])
    flying = ball().model_copy(update={"velocity": (0.0, 3.0, 0.0)})
    simulator = Simulator(scene(balloon=[flying], obstacle=[moving]), device, 2)
    camera = camera_of(simulator)
    before = camera.depth.numpy().copy()
    camera.eyes.assign([EYE, (1.0, 0.0, 4.0)])
    simulator.observations["centers"]
    for _ in range(3):
        simulator.advance()
    depth = camera.depth.numpy()
    np.testing.assert_array_equal(depth, camera_of(simulator, camera.eyes.numpy()).depth.numpy())
    both = np.isfinite(before[0]) & np.isfinite(depth[0])
    assert np.abs(depth[0][both] - before[0][both]).max() > 0.05
    assert (depth[0] != depth[1]).any()


def test_colors_are_those_of_things():
    red = ball().model_copy(update={"color": (0.7, 0.0, 0.0)})
    blue = ball(CENTER + [0.0, 0.0, -3.0], 4).model_copy(update={"color": (0.0, 0.0, 0.7)})
    green = Sphere(position=(-1.2, 0.0, 0.0), radius=0.4, color=(0.0, 0.6, 0.0))
    camera = camera_in(scene(balloon=[red, blue], sphere=[green], touch=False))
    color, depth = camera.color.numpy()[0].astype(int), camera.depth.numpy()[0]
    assert color.shape == (SIZE[1], SIZE[0], 3)
    assert camera.color.numpy().dtype == np.uint8
    ball_seen = np.isfinite(depths_of_sphere()) & (depth < 5.0)
    for seen, channel in ((color[ball_seen], 0), (color[12:13, 6], 1)):
        assert (seen[:, channel] > 60 + np.delete(seen, channel, axis=1).max(axis=1)).all()
    assert color[np.isinf(depth)].min() > 150
    assert np.ptp(color[ball_seen][:, 0]) > 20, "light comes from somewhere"


def test_holes_are_seen_through():
    mesh, material = sphere_of_quads(4, RADIUS), Material(preset="latex", strength=1e9)
    bursting = Balloon(mesh=mesh, inflation=Inflation(pressure=1.0), material=material)
    simulator = Simulator(scene(balloon=[bursting]), "cpu")
    camera = camera_of(simulator)
    whole = camera.depth.numpy().copy()
    ahead = int(np.argmax(mesh.points[mesh.face_vertex_indices, 2].reshape(-1, 4).sum(axis=1)))
    holes = simulator.state.torn.numpy()
    holes[0, ahead] = 0.0
    simulator.state.torn.assign(holes)
    simulator.observations.refresh()
    farther = camera.depth.numpy()[np.isfinite(whole)] - whole[np.isfinite(whole)]
    assert farther.max() > RADIUS
    assert farther.min() == 0.0


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"eye": (0.0, 1.0)}, r"eye: must be a place, three numbers, or one for each world, of shape"),
        ({"target": np.zeros((3, 3))}, r"target: must be a place"),
        ({"target": EYE}, r"target: must not be where the eye is, in world 0"),
        ({"width": 0}, r"width: must be a whole number from 1 to 4096 \(got 0\)"),
        ({"angle": 0.0}, r"angle: must be from 1 to 170 degrees \(got 0.0\)"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(given: dict[str, Any], sentence: str):
    with pytest.raises(InputError, match=f"camera: {sentence}"):
        Simulator(scene(), "cpu", 2).observations.camera(**{"eye": EYE, "target": (0.0, 0.0, 0.0)} | given)


def test_a_world_that_blew_up_is_seen_without_its_balloon():
    simulator = Simulator(scene(balloon=[ball()]), "cpu", 2)
    points = simulator.state.points.numpy()
    points[1] = np.nan
    simulator.state.points.assign(points)
    depth = camera_of(simulator).depth.numpy()
    assert np.isfinite(depth[0]).any()
    assert np.isinf(depth[1]).all()


PICTURES = Path(__file__).parent.parent / "docs" / "pictures"
KEPT = Path(__file__).parent / "kept"
COLORFUL = 70
"""spread of the three differences of a pixel from the paper: balloons and their spheres have more, shades less"""


def silhouette(path: Path) -> np.ndarray:
    """Return the mask of pixels of another color than the paper in the corners, which show the scene's subject."""
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    corners = pixels[[0, 0, -1, -1], [0, -1, 0, -1]]
    return np.ptp(pixels - np.median(corners, axis=0).astype(int), axis=2) > COLORFUL


@pytest.mark.parametrize("name", bundled_scenes())
def test_what_a_scene_is_about_fills_a_third_of_its_pictures_height(name: str):
    colorful = silhouette(PICTURES / f"{name}.png")
    # Two pixels, not one: no stray one counts.
    assert (colorful.sum(axis=1) >= 2).mean() >= 1.0 / 3.0
    assert colorful.mean() >= 0.03


@pytest.mark.parametrize("name", MOVING)
def test_an_animation_stands_beside_the_command_that_makes_it(name: str):
    first, last, rate, zoom, look_at = MOVING[name]
    size = "x".join(map(str, MOVING_SIZE))
    options = f"-o {name}.webp --size {size} --frames {first}:{last} --fps {rate:g}"
    options += f" --zoom {zoom:g}" if zoom else ""
    options += " --look-at " + ",".join(f"{place:g}" for place in look_at) if look_at else ""
    gallery = (PICTURES.parent / "GALLERY.md").read_text(encoding="utf-8")
    assert f"`balloon-warp render {name}.usdc {options}`" in gallery
    with Image.open(PICTURES / f"{name}.webp") as shown:
        assert shown.size == MOVING_SIZE
        count = int((last - first) * rate / load_scene(name).frames_per_second + 1e-9) + 1
        assert 0.7 * count <= shown.n_frames <= count  # frames that are alike are one


def likeness(one: np.ndarray, other: np.ndarray) -> float:
    """Return the structural similarity (Wang et al. 2004) of two pictures, averaged over windows and colors."""
    size, c1, c2 = 8, (0.01 * 255.0) ** 2, (0.03 * 255.0) ** 2
    windows = [np.lib.stride_tricks.sliding_window_view(p.astype(float), (size, size), (0, 1)) for p in (one, other)]
    x, y = (window[::4, ::4] for window in windows)
    mean_x, mean_y = x.mean((-1, -2)), y.mean((-1, -2))
    covariance = (x * y).mean((-1, -2)) - mean_x * mean_y
    alike = (2.0 * mean_x * mean_y + c1) * (2.0 * covariance + c2)
    return float((alike / ((mean_x**2 + mean_y**2 + c1) * (x.var((-1, -2)) + y.var((-1, -2)) + c2))).mean())


VIEWS = {"front": {}, "above": {"elevation": 70.0}, "clear": {"transparent": True, "azimuth": 200.0}}


@pytest.mark.full
@pytest.mark.parametrize("name", VIEWS)
def test_a_small_world_looks_as_it_did(name: str, tmp_path):
    """A regression of the picture fails. To accept a change run this file by `python`, and look at tests/kept."""
    made, kept = tmp_path / "made.png", KEPT / f"{name}.png"
    small_world(world := tmp_path / "world.usda")
    render_stage(world, made, size=(160, 90), samples=16, device="cpu", **VIEWS[name])
    one, other = (np.asarray(Image.open(path)).astype(int) for path in (made, kept))
    # Another machine's round-off moves some samples over an edge: 0.999. Without foil's mirror it is 0.95 or less.
    assert likeness(one, other) > 0.99
    assert np.abs(one - other).mean() < 1.0


if __name__ == "__main__":
    KEPT.mkdir(exist_ok=True)
    small_world(world := KEPT / "world.usda")
    for view, how in VIEWS.items():
        render_stage(world, KEPT / f"{view}.png", size=(160, 90), samples=16, device="cpu", **how)
    world.unlink()
