"""View of pictures: direction, target, and the frames of an animation."""

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Usd, UsdGeom

from balloon_warp import InputError, render_stage
from balloon_warp.cli.size import parse_frames, parse_place
from balloon_warp.outputs.camera import Camera
from balloon_warp.outputs.render.render import _choose_frames
from balloon_warp.outputs.render.stage_reader import RenderStage
from balloon_warp.outputs.render.view import View

FRAMES, RATE = 20, 40.0


@pytest.fixture(scope="module", params=["Y", "Z"])
def stage(request, tmp_path_factory) -> RenderStage:
    """Write a stage of a soft square of side 0.2 that rises by 10 in 20 frames, and a sphere that stays."""
    path = tmp_path_factory.mktemp("stage") / "rise.usda"
    made = Usd.Stage.CreateNew(str(path))
    made.SetDefaultPrim(UsdGeom.Xform.Define(made, "/World").GetPrim())
    UsdGeom.SetStageUpAxis(made, request.param)
    made.SetStartTimeCode(0)
    made.SetEndTimeCode(FRAMES)
    made.SetTimeCodesPerSecond(RATE)
    soft = UsdGeom.Mesh.Define(made, "/World/soft")
    soft.CreateFaceVertexCountsAttr([4])
    soft.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    up = np.eye(3)["XYZ".index(request.param)]
    for frame in range(FRAMES + 1):
        square = np.array([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)]) @ np.stack([[1.0, 0, 0], up])
        points = [Gf.Vec3f(*map(float, place)) for place in square + 0.5 * frame * up]
        soft.GetPointsAttr().Set(points, frame)
        soft.GetExtentAttr().Set([points[0], points[2]], frame)
    ball = UsdGeom.Sphere.Define(made, "/World/ball")
    ball.CreateRadiusAttr(0.5)
    ball.CreateExtentAttr([(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)])
    ball.AddTranslateOp().Set(Gf.Vec3d(3.0, 0.0, 0.0))
    made.Save()
    found = RenderStage(path)
    found.read_prims(0)
    return found


def seen(camera: Camera, point: tuple[float, float, float]) -> np.ndarray:
    """Return the place of a point in the picture, Y up: -1 to 1 each way."""
    x, y, z = camera.axes @ (np.array(point) - camera.eye)
    return np.array([x / -z / camera.half_width, y / -z / camera.half_height])


def cameras(stage: RenderStage, **how) -> list[Camera]:
    _, camera = View(**how).cameras(stage, list(range(FRAMES + 1)), 16 / 9)
    return [camera(frame) for frame in range(FRAMES + 1)]


def test_zoom_makes_all_as_many_times_as_large(stage: RenderStage):
    once, twice = cameras(stage)[0], cameras(stage, zoom=2.0)[0]
    for point in ((3.0, 0.0, 0.0), (0.0, 5.0, 0.0)):
        np.testing.assert_allclose(seen(twice, point), 2.0 * seen(once, point), atol=1e-9)


def test_what_is_named_is_in_the_middle(stage: RenderStage):
    named = cameras(stage, look_at="ball")[FRAMES]
    np.testing.assert_allclose(seen(named, (3.0, 0.0, 0.0)), 0.0, atol=1e-6)
    point = cameras(stage, look_at=(1.0, 2.0, 3.0))[0]
    up = UsdGeom.GetStageUpAxis(stage.stage)
    np.testing.assert_allclose(seen(point, (1.0, 2.0, 3.0) if up == "Y" else (1.0, 3.0, -2.0)), 0.0, atol=1e-6)
    np.testing.assert_allclose(named.axes, cameras(stage)[0].axes)


@pytest.mark.parametrize("look_at", [None, "soft"])
def test_a_camera_that_follows_keeps_its_subject_large_and_in_the_middle(stage: RenderStage, look_at: str | None):
    """A camera that follows keeps its subject large: a balloon that rises 50 times its size is a speck without."""
    for frame, camera in enumerate(cameras(stage, follow=True, look_at=look_at)):
        corners = np.array([seen(camera, (x, 0.5 * frame + y, 0.0)) for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
        assert np.abs(corners).max() < 0.9
        assert np.ptp(corners[:, 1]) > 1.2
    still = np.array([seen(cameras(stage)[0], (0.0, y, 0.0)) for y in (-0.1, 0.1)])
    assert np.ptp(still[:, 1]) < 0.1


def test_a_stage_says_from_where_its_picture_is_taken_unless_one_asks(stage: RenderStage, tmp_path):
    """A stage's view is used unless a call gives one or follows something, and garbage is ignored."""
    plain = cameras(stage)[0]
    said = {"azimuth": 70.0, "elevation": 40, "zoom": 3.0, "look_at": Gf.Vec3d(1.0, 2.0, 3.0)}
    stage.stage.GetRootLayer().customLayerData = {"balloonWarp": {"pictureView": said | {"other": 1.0}}}
    try:
        asked = cameras(stage, azimuth=70.0, elevation=40.0, zoom=3.0, look_at=(1.0, 2.0, 3.0))[0]
        as_said, turned, followed = cameras(stage)[0], cameras(stage, azimuth=10.0)[0], cameras(stage, follow=True)[0]
        np.testing.assert_allclose([as_said.eye, *as_said.axes], [asked.eye, *asked.axes])
        assert as_said.half_width == asked.half_width == turned.half_width
        assert not np.allclose(turned.axes, asked.axes)
        assert followed.half_width == plain.half_width
        for garbage in ("text", {"zoom": "large", "look_at": 3.0}):
            stage.stage.GetRootLayer().customLayerData = {"balloonWarp": {"pictureView": garbage}}
            np.testing.assert_array_equal(cameras(stage)[0].eye, plain.eye)
    finally:
        stage.stage.GetRootLayer().customLayerData = {}


def test_a_lens_is_focused_on_what_is_named(stage: RenderStage):
    up = UsdGeom.GetStageUpAxis(stage.stage)
    for named, place in (
        ("ball", (3.0, 0.0, 0.0)),
        ((1.0, 2.0, 3.0), (1.0, 2.0, 3.0) if up == "Y" else (1.0, 3.0, -2.0)),
    ):
        camera = cameras(stage, aperture=0.1, focus=named)[0]
        assert camera.aperture == 0.1
        assert camera.focus == pytest.approx((camera.eye - place) @ camera.axes[2])
    middle = cameras(stage, aperture=0.1, look_at="ball")[0]
    assert middle.focus == pytest.approx((middle.eye - [3.0, 0.0, 0.0]) @ middle.axes[2])


@pytest.mark.parametrize(
    ("how", "complaint"),
    [
        ({"zoom": 0.0}, "zoom: 0; expected 0.01 to 100"),
        ({"zoom": float("nan")}, "zoom: nan; expected"),
        ({"look_at": "nobody"}, "look-at: 'nobody' is not visible in .*; visible are .*ball"),
        ({"look_at": "bal"}, r"look-at: 'bal' is not visible in .*; did you mean ball\?"),
        ({"look_at": (1.0, 2.0, 3.0), "follow": True}, "follow: a point does not move"),
        ({"aperture": -1.0}, "aperture: -1; expected the lens's diameter, 0 or more"),
        ({"focus": "ball"}, "focus: needs an aperture"),
        ({"focus": "nobody", "aperture": 0.1}, "focus: 'nobody' is not visible"),
        ({"shutter": 1.5}, "shutter: 1.5; expected 0 to 1 of a frame"),
        ({"transparent": True}, r"transparent: out\.gif has no transparency; expected \.png or \.webp"),
        ({"frames": (5, 99)}, "frames: 5:99 is not in .*; expected a range in 0:20"),
        ({"frames": (9, 5)}, "frames: 9:5 is not in"),
        ({"frames_per_second": 0.0}, r"fps: 0; expected 0\.01 to 1000"),
    ],
)
def test_mistakes_are_told(stage: RenderStage, tmp_path, how: dict, complaint: str):
    with pytest.raises(InputError, match=complaint):
        render_stage(stage.path, tmp_path / "out.gif", size=(32, 18), samples=1, **how)
    assert list(tmp_path.iterdir()) == []


def test_one_picture_has_no_rate(stage: RenderStage, tmp_path):
    for how in ({"frames": (1, 3)}, {"frames_per_second": 10.0}):
        with pytest.raises(InputError, match="one picture has no frames and no rate"):
            render_stage(stage.path, tmp_path / "out.png", **how)


def test_a_part_at_another_rate_keeps_its_speed(stage: RenderStage, tmp_path):
    """A part of 40 frames a second at 10 takes every fourth."""
    shown = render_stage(
        stage.path, tmp_path / "out.gif", size=(192, 108), samples=1, frames=(4, None), frames_per_second=10.0
    )
    assert shown == [4, 8, 12, 16, 20]
    with Image.open(tmp_path / "out.gif") as picture:
        assert (picture.n_frames, picture.info["duration"]) == (5, 100)
    assert _choose_frames(stage, ".mp4", None, (None, 2), 80.0) == ([0, 0, 1, 2, 2], 1.0 / 80.0)


def test_webp_moves_at_the_stages_speed_and_one_frame_is_a_picture(stage: RenderStage, tmp_path):
    small = {"size": (64, 36), "samples": 1, "device": "cpu"}
    assert render_stage(stage.path, tmp_path / "a.webp", frames_per_second=RATE, **small) == list(range(FRAMES + 1))
    with Image.open(tmp_path / "a.webp") as animation:
        assert (animation.format, animation.size) == ("WEBP", (64, 36))
        milliseconds = 0
        for number in range(animation.n_frames):  # of pictures that are the same, one is kept, as long as all of them
            animation.seek(number)
            animation.load()
            milliseconds += animation.info["duration"]
    assert milliseconds == (FRAMES + 1) * 1000 / RATE
    render_stage(stage.path, tmp_path / "one.webp", frames=(3, 3), **small)
    with Image.open(tmp_path / "one.webp") as picture:
        assert getattr(picture, "n_frames", 1) == 1


def test_words_of_the_command_line():
    assert parse_frames("10:90") == (10, 90)
    assert parse_frames(":90") == (None, 90)
    assert parse_place("squirrel") == "squirrel"
    assert parse_place("1,-2,.5") == (1.0, -2.0, 0.5)
    for parse, text in ((parse_frames, "10-90"), (parse_frames, "90"), (parse_place, "1,2"), (parse_place, "1,2,x")):
        with pytest.raises(InputError, match="expected"):
            parse(text)
