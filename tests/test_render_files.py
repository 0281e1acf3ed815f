"""Picture files, their views and frames, and messages where none can be made."""

import errno
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Usd, UsdGeom
from render_stages import add_camera, add_curves, add_ground, add_mesh, add_sphere, new_stage, quad_sphere, upright
from render_stages import read_stage as read

from balloon_warp import InputError, MissingExtraError, render_stage
from balloon_warp.cli.options import parse_frames, parse_place
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
    """The last frame is drawn, or the one that a call names."""
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


def full_disk(_: Path) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def usd_failure(folder: Path) -> None:
    Usd.Stage.Open(str(folder / "none.usda"))  # raises one of USD's own exceptions


@pytest.mark.parametrize("fail", [full_disk, usd_failure])
def test_a_write_that_fails_gets_a_sentence(fail: Callable[[Path], None], tmp_path):
    def write_half() -> None:
        with whole_file(tmp_path / "a.usda") as temporary:
            temporary.write_text("half a st")
            fail(tmp_path)

    with pytest.raises(InputError, match=r"a\.usda: cannot be written: "):
        write_half()
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
        ("a.png", {"azimuth": float("nan")}, "azimuth: nan degrees; expected a finite angle"),
        ("a.png", {"elevation": -1.0}, "elevation: -1 degrees; expected 0 to 90"),
        ("a.png", {"elevation": 91.0}, "elevation: 91 degrees; expected 0 to 90"),
        ("a.png", {"size": (0, 10)}, "size: a picture of 0x10 pixels; expected at least 1x1"),
        ("a.png", {"size": (8193, 10)}, "size: a picture of 8193x10 pixels; expected at most 8192x8192"),
        ("a.png", {"samples": 10**9}, "samples: 1000000000 rays a pixel; expected at most 4096"),
        ("x" * 252 + ".png", {}, "cannot be written: File name too long"),
        ("a:SDF_FORMAT_ARGS:b.png", {}, "expected a name without it"),
        ("a.png", {"device": "cuda:99"}, "cuda:99: no such device; this machine has cpu"),
        ("a.png", {"zoom": 0.0}, "zoom: 0; expected 0.01 to 100"),
        ("a.png", {"zoom": float("nan")}, "zoom: nan; expected"),
        ("a.png", {"look_at": "nobody"}, "look-at: 'nobody' is not visible in .*; visible are .*Ball"),
        ("a.png", {"look_at": "bal"}, r"look-at: 'bal' is not visible in .*; did you mean Ball\?"),
        ("a.png", {"look_at": (1.0, 2.0, 3.0), "follow": True}, "follow: a point does not move"),
        ("a.png", {"aperture": -1.0}, "aperture: -1; expected the lens's diameter, 0 or more"),
        ("a.png", {"focus": "Ball"}, "focus: needs an aperture"),
        ("a.png", {"focus": "nobody", "aperture": 0.1}, "focus: 'nobody' is not visible"),
        ("a.png", {"shutter": 1.5}, "shutter: 1.5; expected 0 to 1 of a frame"),
        ("a.gif", {"transparent": True}, r"transparent: a\.gif has no transparency; expected \.png or \.webp"),
        ("a.gif", {"frames": (5, 99)}, "frames: 5:99 is not in .*; expected a range in 0:47"),
        ("a.gif", {"frames": (9, 5)}, "frames: 9:5 is not in"),
        ("a.gif", {"frames_per_second": 0.0}, r"fps: 0; expected 0\.01 to 1000"),
        ("a.png", {"frames": (1, 3)}, "one picture has no frames and no rate"),
        ("a.png", {"frames_per_second": 10.0}, "one picture has no frames and no rate"),
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
        (lambda made: add_camera(made, 5.0, 50.0, 0.0), "Camera at frame 0 has an aperture of 0 "),
        (
            lambda made: add_camera(made, 5.0, 50.0).AddScaleOp().Set(Gf.Vec3f(0.0)),
            "Camera .* has a transform that is singular",
        ),
        (lambda made: add_curves(made, "Lines", [(0, 0, 0)] * 3, [4, -1], 0.1, [(1, 0, 0)]), "a curve has -1 points"),
        (lambda made: add_curves(made, "Lines", [(0, 0, 0)] * 3, [4], 0.1, [(1, 0, 0)]), "has 3 points .* expected 4"),
        (lambda made: add_curves(made, "Lines", [(0, 0, 0)] * 2, [2], np.nan, [(1, 0, 0)]), "a width is negative or"),
        (lambda made: add_sphere(made, "Bad", (0, 0, 0), np.inf, (1, 0, 0)), "its center or radius at frame 0 is not"),
        (lambda made: add_mesh(made, "Bad", np.eye(3), [4, -1], [0, 1, 2], (1, 0, 0)), "its faces do not match its 3"),
        (
            lambda made: add_mesh(made, "Bad", BALL[0][:-1], *BALL[1:], (1, 0, 0)),
            "its faces do not match its 25 points",
        ),
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
