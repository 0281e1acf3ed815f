"""Contents of pictures, compared with optics, and parts of the ray caster, each against its definition."""
# pyright: reportIndexIssue=false

from pathlib import Path

import numpy as np
import pytest
import render_stages
import warp as wp
from exported import at_start
from meshes import quad_sphere as sphere_of_quads
from PIL import Image
from pxr import Gf, Usd, UsdGeom, UsdShade
from render_stages import LATEX, add_ground, add_mesh, add_sphere, before_camera, new_stage, picture, quad_sphere

from balloon_warp import Balloon, Ground, Scene, load_scene, render_stage
from balloon_warp.kernels import OPTIONS
from balloon_warp.kernels.pictures import surfaces
from balloon_warp.mesh.orientation import CREASE
from balloon_warp.mesh.polygon_mesh import PolygonMesh
from balloon_warp.studio.render.render import Film, RayCaster
from balloon_warp.studio.render.sampling import SmoothSurface, moments, one_over_the_other
from balloon_warp.studio.render.view import frame_action
from balloon_warp.usd.studio import MARGIN, Camera, CameraFit

BLACK = (0.0, 0.0, 0.0)
RED, GREEN, BLUE = (0.8, 0.02, 0.02), (0.02, 0.6, 0.05), (0.02, 0.05, 0.8)
WHITE, GRAY = (0.9, 0.9, 0.9), (0.3, 0.3, 0.3)
LATEX_RED, LATEX_GREEN = (0.8, 0.04, 0.04), (0.02, 0.6, 0.05)
HALF_COVERED = 175
"""sRGB byte of half black, half backdrop: the backdrop is about 0.86 in linear light, half of it 0.43"""


def pixel_of(camera: Camera, point, size: tuple[int, int]) -> tuple[int, int]:
    """Return the row and column where a camera sees a point."""
    x, y, back = camera.axes @ (np.asarray(point) - camera.eye)
    across, up = x / -back / camera.half_width, y / -back / camera.half_height
    return int((1.0 - up) * size[1] / 2), int((1.0 + across) * size[0] / 2)


@pytest.mark.parametrize("shape", ["sphere", "mesh"])
def test_a_sphere_covers_the_area_that_a_pinhole_sees(shape: str, tmp_path):
    stage = new_stage(tmp_path / "stage.usda")
    render_stages.add_camera(stage, distance=5.0, focal_length=40.0, aperture=24.0)
    if shape == "sphere":
        add_sphere(stage, "Ball", (0, 0, 0), 1.0, BLACK, roughness=1.0)
    else:
        add_mesh(stage, "Ball", *quad_sphere(4), BLACK, roughness=1.0)
    seen = picture(stage, size=(300, 300))
    # The outline's cone has tangent r / sqrt(d^2 - r^2); the picture's half height has 12 / 40.
    radius = 150 * (1.0 / np.sqrt(24.0)) / (12.0 / 40.0)
    # 1%: a sixteen-sided outline, which the mesh has before it is refined, would lack 2.6%.
    assert (seen.max(axis=2) < HALF_COVERED).sum() == pytest.approx(np.pi * radius**2, rel=0.01)


def test_a_moving_sphere_is_seen_where_it_is(tmp_path):
    centers = [(-0.8, 0.3, 0.0), (0.0, 0.0, 0.0), (0.6, -0.9, 0.0)]
    stage = before_camera(tmp_path / "stage.usda", frames=3)
    add_sphere(stage, "Ball", centers, 0.2, BLACK, roughness=1.0)
    for frame, center in enumerate(centers):
        rows, columns = np.nonzero(picture(stage, frame=frame).max(axis=2) < HALF_COVERED)
        expected = 100 + 100 * np.array([center[0], -center[1]]) / (10.0 * 12.0 / 60.0)
        # Half a pixel: the outline of a sphere off the axis is an ellipse, whose middle lies 0.04% farther out.
        assert [columns.mean() + 0.5, rows.mean() + 0.5] == pytest.approx(expected.tolist(), abs=0.5)


def test_the_same_bytes_whatever_the_number_of_threads(tmp_path):
    path = tmp_path / "stage.usda"
    render_stages.small_world(path)
    pictures = []
    for threads in (1, 2, 3, 1):
        stage = render_stages.read_stage(path)
        framing = frame_action([(stage, 0)], 16 / 9)
        caster = RayCaster(stage, framing, Film((160, 90), 4), "cpu", threads)
        caster.place(0, 0.0)
        pictures.append(caster.picture(framing.camera).tobytes())
    assert len(set(pictures)) == 1


def test_each_device_makes_the_same_picture(device: str, tmp_path):
    stage = render_stages.small_world(tmp_path / "stage.usda")
    seen = [picture(stage, device=each) for each in ("cpu", device)]
    # Round-off may move a sample across an edge; nothing else may change.
    assert np.abs(seen[0] - seen[1]).mean() < 0.1


@pytest.mark.full
def test_units_and_axes_do_not_show(tmp_path):
    seen = [picture(render_stages.small_world(tmp_path / f"{up}.usda", up)) for up in ("Y", "Z")]
    assert (seen[0] == seen[1]).all()
    seen = []
    for factor in (1.0, 1000.0):
        stage = render_stages.small_world(tmp_path / f"{factor}.usda")
        UsdGeom.Xform(stage.GetDefaultPrim()).AddScaleOp().Set(Gf.Vec3f(factor))
        seen.append(picture(stage))
    # Round-off may move a sample across an edge; nothing else may change.
    assert np.abs(seen[0] - seen[1]).mean() < 0.05


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize(
    ("azimuth", "elevation", "nearest"),
    [(0.0, 0.0, RED), (180.0, 0.0, GREEN), (90.0, 0.0, BLUE), (40.0, 90.0, WHITE), (0.0, None, RED)],
)
def test_one_looks_from_where_one_asks(up_axis: str, azimuth: float, elevation: float, nearest, tmp_path):
    stage = new_stage(tmp_path / "stage.usda", up_axis)
    render_stages.add_camera(stage, distance=20.0, focal_length=40.0, aperture=24.0)
    places = {RED: (0, 0, 2), GREEN: (0, 0, -2), BLUE: (2, 0, 0), BLACK: (-2, 0, 0), WHITE: (0, 2, 0), GRAY: (0, -2, 0)}
    for number, (color, place) in enumerate(places.items()):
        add_sphere(stage, f"Ball_{number}", place, 1.0, color, roughness=1.0)
    seen = picture(stage, azimuth=azimuth, elevation=elevation)[95:105, 95:105].mean(axis=(0, 1))
    expected = np.array(nearest)
    np.testing.assert_array_equal(seen > 0.7 * seen.max(), expected > 0.7 * expected.max())


def test_a_ball_shades_the_ground_away_from_the_key_light(tmp_path):
    stage = new_stage(tmp_path / "stage.usda")
    add_ground(stage)
    add_sphere(stage, "Ball", (0.0, 1.5, 0.0), 1.0, BLACK, roughness=1.0)
    add_sphere(stage, "Left", (-4.0, 0.0, 0.0), 0.01, BLACK)
    add_sphere(stage, "Right", (4.0, 0.0, 0.0), 0.01, BLACK)
    size = (240, 240)
    seen = picture(stage, size=size).mean(axis=2)
    reader = render_stages.read_stage(tmp_path / "stage.usda")
    camera = frame_action([(reader, 0)], 1.0).camera
    # The key light comes from (-0.62, 1, 0.62) to the right, up and back: the middle of the shadow is 1.5 times as far.
    right, _, back = camera.axes
    level_back = np.array([back[0], 0.0, back[2]]) / np.hypot(back[0], back[2])
    shadow = 1.5 * (0.62 * right - 0.62 * level_back)
    dark, lit = (seen[pixel_of(camera, place, size)] for place in (shadow, -shadow))
    assert dark < lit - 60
    # Under the ball the sky is hidden, too: darker than far out in the open.
    assert seen[pixel_of(camera, (0.0, 0.0, 0.0), size)] < lit - 10


def test_water_tints_what_is_below_it_and_leaves_what_is_above(tmp_path):
    seen = []
    for name in ("Water", None):
        stage = new_stage(tmp_path / f"{name}.usda")
        add_sphere(stage, "Ball", (0.0, 0.0, 0.0), 1.0, (0.5, 0.5, 0.5), roughness=1.0)
        if name:
            corners = [(-50, 0, 50), (50, 0, 50), (50, 0, -50), (-50, 0, -50)]
            add_mesh(stage, name, corners, [4], [0, 1, 2, 3], (0.1, 0.2, 0.8), roughness=0.1, opacity=0.5)
        seen.append(picture(stage, size=(120, 120)))
        reader = render_stages.read_stage(tmp_path / f"{name}.usda")
        camera = frame_action([(reader, 0)], 1.0).camera
    wet, dry = seen
    backward = camera.axes[2] / np.linalg.norm(camera.axes[2][[0, 2]])
    below = pixel_of(camera, np.array([0.0, -0.6, 0.0]) + 0.8 * np.array([backward[0], 0.0, backward[2]]), (120, 120))
    above = pixel_of(camera, (0.0, 1.0, 0.0), (120, 120))
    np.testing.assert_allclose(wet[above[0] + 3, above[1]], dry[above[0] + 3, above[1]], atol=2)
    blueness = [int(picture[below][2] - picture[below][0]) for picture in (wet, dry)]
    assert blueness[0] > blueness[1] + 20


def test_curves_have_their_colors_and_stay_visible_when_thin(tmp_path):
    stage = before_camera(tmp_path / "stage.usda")
    lines = [(-1.0, 1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, -1.0, 0.0), (0.0, -1.0, 0.0), (1.0, -1.0, 0.0)]
    render_stages.add_curves(stage, "Lines", lines, [2, 3], 0.0, [RED, GREEN])
    seen = picture(stage)
    red = seen[..., 0] - seen[..., 1] > 25
    green = seen[..., 1] - seen[..., 0] > 25
    # 2 units span 100 of 200 pixels: row 50 and row 150, columns 50 to 150. No widths: 1.3 pixels.
    for color, row in ((red, 50), (green, 150)):
        rows, columns = np.nonzero(color)
        assert set(rows) <= {row - 2, row - 1, row, row + 1}
        assert np.any(color, axis=0)[51:149].all(), "a gap"
        assert (columns.min(), columns.max()) == pytest.approx((50, 149), abs=1)


@pytest.mark.full
def test_latex_shows_what_is_inside_and_an_opaque_wall_does_not(tmp_path):
    differences = []
    for opacity in (0.92, 1.0):
        seen = []
        for inside in (BLACK, (0.9, 0.9, 0.9)):
            stage = new_stage(tmp_path / f"{opacity}{inside[0]}.usda")
            add_mesh(stage, "Balloon", *quad_sphere(8), RED, **LATEX | {"opacity": opacity})
            add_sphere(stage, "Inside", (0.0, 0.0, 0.0), 0.6, inside, roughness=1.0)
            seen.append(picture(stage))
        differences.append(np.abs(seen[0] - seen[1])[90:110, 90:110].mean())
    assert differences[0] > 5.0
    assert differences[1] == 0.0


def test_what_is_hidden_is_not_drawn(tmp_path):
    stage = before_camera(tmp_path / "stage.usda")
    add_sphere(stage, "Ball", (-0.8, 0.0, 0.0), 0.4, RED, roughness=1.0)
    invisible = add_sphere(stage, "Invisible", (0.8, 0.8, 0.0), 0.4, GREEN, roughness=1.0)
    invisible.MakeInvisible()
    guide = add_sphere(stage, "Guide", (0.8, -0.8, 0.0), 0.4, GREEN, roughness=1.0)
    guide.CreatePurposeAttr(UsdGeom.Tokens.guide)
    seen = picture(stage)
    assert (seen[..., 0] - seen[..., 1] > 50).any()
    assert not (seen[..., 1] - seen[..., 0] > 20).any()


def test_what_comes_and_goes_is_drawn_while_it_is_there(tmp_path):
    """A string that is cut is gone from then on, and a film may end with nothing in it."""
    stage = before_camera(tmp_path / "stage.usda", frames=3)
    for name, place, color, there in (("Left", -0.8, RED, (1, 1, 0)), ("Right", 0.8, GREEN, (0, 1, 0))):
        shown = add_sphere(stage, name, (place, 0.0, 0.0), 0.4, color, roughness=1.0).CreateVisibilityAttr()
        for frame, seen in enumerate(there):
            shown.Set(UsdGeom.Tokens.inherited if seen else UsdGeom.Tokens.invisible, frame)
    stage.GetRootLayer().Save()
    render_stage(tmp_path / "stage.usda", film := tmp_path / "film.webp", size=(64, 64), device="cpu")
    found = []
    with Image.open(film) as shown:
        for frame in range(3):
            shown.seek(frame)
            red, green, _ = np.moveaxis(np.asarray(shown.convert("RGB"), int), 2, 0)
            found.append(((red - green > 50).any(), (green - red > 20).any()))
    assert found == [(True, False), (True, True), (False, False)]


@pytest.mark.full
def test_a_mesh_that_moves_looks_the_same_in_an_animation_as_alone(tmp_path):
    path = tmp_path / "stage.usda"
    stage = new_stage(path, frames=3)
    points, counts, indices = quad_sphere(6)
    mesh = add_mesh(stage, "Balloon", points, counts, indices, RED, **LATEX)
    for frame in range(3):
        mesh.GetPointsAttr().Set((points * (1.0 + 0.5 * frame) + [0.3 * frame, 0, 0]).astype(np.float32), frame)
    render_stages.add_camera(stage, distance=12.0, focal_length=60.0, aperture=24.0)
    alone = picture(stage, frame=2)
    reader = render_stages.read_stage(path)
    framing = frame_action([(reader, 2)], 1.0)
    caster = RayCaster(reader, framing, Film((200, 200), 4), "cpu")
    camera = reader.camera(2, 1.0)
    assert camera is not None
    for frame in range(3):
        caster.place(frame, 0.0)
    # The tree over the triangles was built for frame 0: only the order in which it is searched differs.
    assert np.abs(caster.picture(camera) - alone).mean() < 0.05


def test_a_cube_is_flat_to_its_edges_whether_it_moves_or_not(tmp_path):
    spreads = []
    for name, frames in (("still", 0), ("moving", 1)):
        stage = before_camera(tmp_path / f"{name}.usda")
        points, counts, indices = quad_sphere(1)  # a cube's, but for its size
        points = np.sign(points)
        mesh = add_mesh(stage, "Cube", points, counts, indices, RED, roughness=1.0)
        if frames:
            mesh.GetPointsAttr().Set(points.astype(np.float32), 0)
        seen = picture(stage)
        # The front, 2 units wide and 9 away, covers 111 of 200 pixels.
        spreads.append(np.ptp(seen[50:150, 50:150, 0]))
    # The lights are infinitely far away: a flat matte side has one color, but for a little gloss.
    assert max(spreads) < 12


@pytest.mark.parametrize("interpolation", [UsdGeom.Tokens.uniform, UsdGeom.Tokens.faceVarying, UsdGeom.Tokens.vertex])
def test_display_colors_lie_where_their_interpolation_says(interpolation: str, tmp_path):
    stage = new_stage(tmp_path / "stage.usda")
    mesh = UsdGeom.Mesh.Define(stage, "/World/Squares")
    mesh.CreatePointsAttr([(x, y, 0.0) for y in (-1.0, 1.0) for x in (-2.0, 0.0, 2.0)])
    mesh.CreateFaceVertexCountsAttr([4, 4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 4, 3, 1, 2, 5, 4])
    colors = {
        UsdGeom.Tokens.uniform: [RED, GREEN],
        UsdGeom.Tokens.faceVarying: [RED] * 4 + [GREEN] * 4,
        UsdGeom.Tokens.vertex: [RED, RED, GREEN] * 2,
    }
    mesh.CreateDisplayColorPrimvar(interpolation).Set(colors[interpolation])
    render_stages.add_camera(stage, distance=10.0, focal_length=40.0, aperture=24.0)
    seen = picture(stage)
    redness = seen[100, :, 0] - seen[100, :, 1]
    # 4 units span 133 of 200 pixels; the squares meet at column 100.
    assert (redness[40:98] > 60).all()
    if interpolation == UsdGeom.Tokens.vertex:
        assert redness[101] > 60
        assert (np.diff(redness[102:160]) <= 3).all()
    else:
        assert (redness[102:160] < -60).all()


SIZE = 200


def darkness(pixels: np.ndarray) -> np.ndarray:
    """Return the fraction of black before the backdrop, as bright as at the right, in linear light."""
    light = (pixels[..., 1] / 255.0) ** 2.2
    return np.clip(1.0 - light / light[:, 185:190].mean(axis=1, keepdims=True), 0.0, 1.0)


def edge_width(row: np.ndarray) -> float:
    """Return the number of pixels in which darkness falls from nine tenths to one, beside the middle."""
    half = row[len(row) // 2 :]
    return float((half < 0.1).argmax() - (half < 0.9).argmax())


@pytest.mark.full
def test_a_lens_blurs_what_is_out_of_focus_by_as_much_as_geometry_says(tmp_path):
    """A point of a ball 10 away, with the lens focused at 5, is blurred to a disc of the lens's diameter times (10 - 5)
    / 5, as seen at 10. Of a disc's shadow over an edge nine tenths lie within 0.68 of its diameter."""
    stage = before_camera(tmp_path / "stage.usda")
    add_sphere(stage, "Ball", (0.0, 0.0, 0.0), 1.2, BLACK, roughness=1.0)
    widths = {}
    for focus in (0.0, 5.0):
        seen = picture(stage, aperture=0.4, focus=(0.0, 0.0, focus), samples=64, look_at=None)
        widths[focus] = np.median([edge_width(row) for row in darkness(seen)[96:104]])
    assert widths[0.0] <= 2.0
    # 50 pixels a unit there: 0.4 is 20 pixels.
    assert widths[5.0] == pytest.approx(0.68 * 20.0, abs=2.5)


def test_an_open_shutter_smears_what_moves_along_its_way(tmp_path):
    stage = before_camera(tmp_path / "stage.usda", frames=3)
    add_sphere(stage, "Ball", [(-1.0, 0, 0), (0.0, 0, 0), (1.0, 0, 0)], 0.2, BLACK, roughness=1.0)
    sharp, smeared = (darkness(picture(stage, frame=1, shutter=open_for)) for open_for in (0.0, 0.5))
    # 50 pixels a unit: 20 wide, and half a frame's way, 25, longer to the right; the sum of darkness is the same.
    columns = [np.flatnonzero(seen[100] > 0.05) for seen in (sharp, smeared)]
    assert columns[0][[0, -1]] == pytest.approx([90, 109], abs=1)
    assert columns[1][[0, -1]] == pytest.approx([90, 134], abs=4)
    assert smeared.sum() == pytest.approx(sharp.sum(), rel=0.05)


def test_the_shutter_stays_within_the_stage_and_moments_add_up_as_light_does():
    assert moments(5, 0.0, 9) == [5]
    assert 5.0 < min(moments(5, 0.5, 9)) < max(moments(5, 0.5, 9)) < 5.5
    assert 8.5 < min(moments(9, 0.5, 9)) < max(moments(9, 0.5, 9)) < 9.0
    black, white = np.zeros((1, 1, 3), np.uint8), np.full((1, 1, 3), 255, np.uint8)
    assert one_over_the_other([black, white])[0, 0, 0] == 188  # half of the light
    gray = np.arange(256, dtype=np.uint8).repeat(3).reshape(1, 256, 3)
    np.testing.assert_array_equal(one_over_the_other([gray, gray]), gray)
    clear, red = np.zeros((1, 1, 4), np.uint8), np.array([[[200, 0, 0, 255]]], np.uint8)
    np.testing.assert_array_equal(one_over_the_other([clear, red]), [[[200, 0, 0, 128]]])


def test_a_transparent_picture_lies_over_its_backdrop_as_if_taken_before_it(tmp_path):
    stage = before_camera(tmp_path / "stage.usda")
    add_sphere(stage, "Ball", (-0.9, 0.0, 0.0), 0.7, BLACK, roughness=1.0)
    add_mesh(stage, "Balloon", *quad_sphere(8, 0.7, (0.9, 0.0, 0.0)), LATEX_RED, **LATEX)
    whole, over = picture(stage), picture(stage, transparent=True)
    opacity = over[..., 3] / 255.0
    assert over.shape == (SIZE, SIZE, 4)
    assert opacity[100, 55] == 1.0
    assert opacity[20, 20] == opacity[180, 100] == 0.0
    assert 0.6 < opacity[100, 145] < 0.98
    # The backdrop is nearly even: without it, the pixels are the rest once its share is taken away.
    share = opacity[..., None]
    together = share * (over[..., :3] / 255.0) ** 2.2 + (1 - share) * (whole[5, 100] / 255) ** 2.2
    assert np.abs(together - (whole / 255.0) ** 2.2)[65:135].mean() < 0.02


def test_a_transparent_picture_keeps_the_shadow_on_the_ground(tmp_path):
    """A transparent picture over the ground's color equals the picture with the ground, with the red light below the
    balloon. The ground is not visible through the balloon."""
    stage = before_camera(tmp_path / "stage.usda")
    add_sphere(stage, "Ball", (-0.9, 0.0, 0.0), 0.5, BLACK, roughness=1.0)
    add_mesh(stage, "Balloon", *quad_sphere(8, 0.5, (0.9, 0.0, 0.0)), LATEX_RED, **LATEX)
    without = picture(stage, elevation=50.0, transparent=True)
    add_ground(stage, -0.6)
    whole, over = picture(stage, elevation=50.0), picture(stage, elevation=50.0, transparent=True)
    things, opacity = without[..., 3] > 0, over[..., 3:] / 255.0
    shaded = ~things & (over[..., 3] > 10)
    assert shaded.sum() > 500
    assert over[shaded][:, 3].max() > 100
    reddish = shaded & (over[..., 0] > over[..., 1] + 20)
    assert reddish.sum() > 100
    bare = np.median(whole[~things & (over[..., 3] == 0)], axis=0)
    together = opacity * over[..., :3] + (1.0 - opacity) * bare
    off = np.abs(together - whole)[shaded]
    # Far away the ground turns into the backdrop, 3 off; the film's curve darkens the darkest pixels, 10 more in 110.
    assert off.mean() < 2.5
    assert off.max() < 12.0
    np.testing.assert_allclose(over[100, 130:140], without[100, 130:140], atol=2)  # there the ground sends up no light


def test_there_is_no_shadow_at_the_bottom_of_water_that_is_left_out(tmp_path):
    stage = new_stage(tmp_path / "stage.usda")
    add_sphere(stage, "Ball", (0.0, 0.0, 0.0), 0.5, BLACK, roughness=1.0)
    add_ground(stage, -0.6)
    shaded = (picture(stage, transparent=True)[..., 3] > 0).sum()
    add_mesh(stage, "Water", [(-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9)], [4], [0, 1, 2, 3], (0.1, 0.4, 0.5))
    assert (picture(stage, transparent=True)[..., 3] > 0).sum() < 0.9 * shaded


FOIL = {"roughness": 0.12, "metallic": 1.0}


def saturation(colors: np.ndarray) -> float:
    """Return the saturation of the mean color, sRGB: 0 for gray, 1 for a pure color."""
    mean = colors.reshape(-1, 3).mean(axis=0)
    return float(1.0 - mean.min() / mean.max())


def test_a_stretched_balloon_is_paler_in_the_middle_than_at_its_rim_and_than_before(tmp_path):
    stage = before_camera(tmp_path / "stage.usda", frames=2)
    points, counts, indices = quad_sphere(8, 0.5)
    ball = add_mesh(stage, "Balloon", points, counts, indices, LATEX_RED, **LATEX)
    for frame in range(2):  # the area is four times as large
        ball.GetPointsAttr().Set((points * (1.0 + frame)).astype(np.float32), frame)
    before, after = (picture(stage, size=(160, 160), frame=frame) for frame in range(2))
    middle = slice(76, 84)
    assert saturation(after[middle, middle]) < saturation(before[middle, middle]) - 0.1
    # Its radius is 1 of the 2 that half of the picture is at its place, 40 pixels: the rim is at 39 of them.
    assert saturation(after[79:81, 42:44]) > saturation(after[middle, middle]) + 0.05


def test_rubber_tints_its_shadow_and_an_opaque_ball_does_not(tmp_path):
    tints = []
    for opacity in (0.92, 1.0):
        stage = new_stage(tmp_path / f"{opacity}.usda")
        add_ground(stage, color=(0.7, 0.7, 0.7))
        add_mesh(stage, "Balloon", *quad_sphere(6, 1.0, (0.0, 3.0, 0.0)), LATEX_RED, **LATEX | {"opacity": opacity})
        for side in (-4.0, 4.0):  # which the picture is as wide as
            add_sphere(stage, f"Side_{side > 0}", (side, 0.0, 0.0), 0.01, LATEX_RED)
        seen = picture(stage, size=(160, 160), azimuth=0.0, elevation=90.0)
        # The key light comes from (-0.62, 1, 0.62): three times as far the other way is the middle of the shadow, at 16
        # pixels a unit.
        shade = seen[47:53, 107:113].mean(axis=(0, 1))
        tints.append(shade[0] - shade[1])
    assert tints[0] > tints[1] + 25
    assert abs(tints[1]) < 20


def test_foil_mirrors_what_is_beside_it_and_lets_nothing_through(tmp_path):
    seen = {}
    for beside in (LATEX_GREEN, None):
        for behind in (LATEX_RED, None):
            stage = before_camera(tmp_path / f"{beside is None}{behind is None}.usda")
            add_mesh(stage, "Foil", *quad_sphere(8, 0.8, (-0.6, 0.0, 0.0)), (0.9, 0.9, 0.9), **FOIL)
            if behind:
                add_sphere(stage, "Behind", (-0.6, 0.0, -1.5), 0.5, LATEX_RED, roughness=1.0)
            if beside:
                add_sphere(stage, "Beside", (0.9, 0.0, 0.0), 0.6, LATEX_GREEN, roughness=1.0)
            seen[beside, behind] = picture(stage, size=(160, 160))
    plain = seen[None, None]
    # The action is larger with the ball behind, so that round-off differs.
    assert np.abs(seen[None, LATEX_RED] - plain)[64:96, 40:72].max() <= 2
    # Its right half, columns 56 to 88, mirrors the ball.
    greener = seen[LATEX_GREEN, None][60:100, 66:86] - plain[60:100, 66:86]
    assert (greener[..., 1] - greener[..., 0]).max() > 40


def test_materials_look_like_what_they_are_unless_said():
    for said, looks in (({"material.preset": "foil"}, "foil"), ({}, "latex"), ({"look": "foil"}, "foil")):
        scene = load_scene("latex_inflate", {f"balloon.0.{name}": value for name, value in said.items()})
        assert scene.balloon[0].looks_like == looks


wp.set_module_options(OPTIONS)


@wp.kernel
def measure_capsules(
    origins: wp.array[wp.vec3], directions: wp.array[wp.vec3], begins: wp.array[wp.vec3], ends: wp.array[wp.vec3],
    radii: wp.array[float], distances: wp.array[float],
):  # fmt: skip
    ray = wp.tid()
    distances[ray] = surfaces.capsule_distance(origins[ray], directions[ray], begins[ray], ends[ray], radii[ray])


@wp.kernel
def develop_gray(light: wp.array[float], out: wp.array[wp.uint8]):
    step = wp.tid()
    out[step] = surfaces.srgb_byte(surfaces.tone(wp.vec3(light[step]))[1])


def test_a_thin_line_is_met_from_afar():
    """A line of one part in 20,000 is hit: the radius squared is far below the round-off of the distance squared."""
    offsets = np.linspace(-1.8e-3, 1.8e-3, 37)
    count = len(offsets)
    origins = np.stack([np.full(count, 0.013), offsets, np.full(count, 20.0)], axis=1)
    rows = [origins, *(np.tile(each, (count, 1)) for each in ([0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]))]
    distances = wp.zeros(count, dtype=float, device="cpu")
    vectors = [wp.array(each, dtype=wp.vec3, device="cpu") for each in rows]
    radii = wp.full(count, 1e-3, dtype=float, device="cpu")
    wp.launch(measure_capsules, count, inputs=[*vectors, radii, distances], device="cpu")
    clear = np.abs(np.abs(offsets) - 1e-3) > 5e-5
    assert ((distances.numpy() > 0.0) == (np.abs(offsets) < 1e-3))[clear].all()


def test_tones_are_neutral_and_end_in_white():
    light = np.array([0.0, 0.02, 0.18, 0.5, 0.8, 2.0, 50.0], np.float32)
    out = wp.zeros(len(light), dtype=wp.uint8, device="cpu")
    wp.launch(develop_gray, len(light), inputs=[wp.array(light, device="cpu"), out], device="cpu")
    # Khronos PBR Neutral takes 0.04 off, or less of darker colors, and compresses above 0.76; then sRGB's power law.
    linear = np.array([0.0, 6.25 * 0.02**2, 0.14, 0.46, 0.76, 1 - 0.0576 / 1.44, 1.0])
    encoded = np.where(linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear)
    assert out.numpy().astype(int) == pytest.approx(255 * encoded, abs=1.0)


@pytest.mark.parametrize("angles", [(), (200.0, 0.0), (-90.0, 90.0)])
@pytest.mark.parametrize("aspect", [16 / 9, 0.5])
def test_the_camera_is_as_near_as_the_margin_lets_it(aspect: float, angles: tuple[float, ...]):
    random = np.random.default_rng(3)
    centers, radii = random.uniform(-3, 5, (30, 3)), random.uniform(0.0, 1.0, 30)
    fit = CameraFit(aspect, *angles)
    fit.include(centers[:10], radii[:10])
    fit.include(centers[10:], radii[10:])
    camera = fit.camera()
    around = random.normal(size=(20_000, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    points = (centers[:, None] + radii[:, None, None] * around).reshape(-1, 3)
    seen = (points - camera.eye) @ camera.axes.T
    assert (seen[:, 2] < 0.0).all()
    across = seen[:, 0] / -seen[:, 2] / camera.half_width
    up = seen[:, 1] / -seen[:, 2] / camera.half_height
    edges = np.array([across.min(), across.max(), up.min(), up.max()])
    # Nothing beyond the margin, and in one of the two directions both sides touch it; 1%: the spheres are sampled.
    assert (np.abs(edges) <= MARGIN + 1e-9).all()
    assert max(np.abs(edges[:2]).min(), np.abs(edges[2:]).min()) == pytest.approx(MARGIN, rel=0.01)
    assert np.linalg.det(camera.axes) == pytest.approx(1.0)


def test_a_crease_between_a_round_and_a_flat_side_has_no_gap():
    sides = 12  # 30 degrees from one to the next, which is smooth; 90 to the lids
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.zeros(sides), -np.sin(angle)], axis=1)
    points = np.concatenate([ring - [0, 1, 0], ring + [0, 1, 0]])
    here = np.arange(sides)
    after = (here + 1) % sides
    walls = np.stack([here, after, after + sides, here + sides], axis=1).ravel()
    indices = np.concatenate([walls, here[::-1], here + sides]).astype(np.int32)
    can = PolygonMesh(points, np.array([4] * sides + [sides] * 2, np.int32), indices)
    surface = SmoothSurface(can, CREASE)
    placed, normals = surface.place(points)
    round_side = np.abs(normals[:, 1]) < 0.5
    assert np.abs(normals[round_side, 1]).max() < 1e-12
    assert np.abs(normals[~round_side, 1]) == pytest.approx(1.0)
    # Each side of an edge has the mirror image in the other: no edge of a triangle is alone in its place.
    _, place = np.unique(placed.round(9), axis=0, return_inverse=True)
    ends = np.sort(place.ravel()[surface.triangles[:, [[0, 1], [1, 2], [2, 0]]]].reshape(-1, 2), axis=1)
    assert set(np.unique(ends, axis=0, return_counts=True)[1]) == {2}
    # Halfway up, where nothing is sharp, the wall is as round as ever: its chords would dip to 0.966.
    middle = np.abs(placed[:, 1]) < 0.01
    assert np.linalg.norm(placed[middle], axis=1).min() > 0.985


PAPER = (0.10, 0.30, 0.32)


def staged(folder: Path, **picture: object) -> Path:
    """Return the stage of a ball above the ground."""
    ball = Balloon(mesh=sphere_of_quads(6, 0.5), color=(0.5, 0.02, 0.02))
    scene = Scene(balloon=[ball], ground=Ground(height=-1.0), picture=picture)
    at_start(scene, folder / "ball.usdc")
    return folder / "ball.usdc"


def test_ground_and_backdrop_are_of_the_paper(tmp_path: Path):
    stage = Usd.Stage.Open(str(staged(tmp_path, paper=PAPER)))
    for path in ("/World/Ground", "/World/Studio/Backdrop"):
        prim = stage.GetPrimAtPath(path)
        assert np.allclose(UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()[0], PAPER)
        material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        surface = material.ComputeSurfaceSource()[0]
        assert np.allclose(surface.GetInput("diffuseColor").Get(), PAPER)
    render_stage(staged(tmp_path, paper=PAPER), tmp_path / "ball.png", size=(64, 36), device="cpu")
    corner = np.asarray(Image.open(tmp_path / "ball.png"))[0, 0].astype(float)
    shown = (corner / 255.0) ** 2.2
    assert shown / shown.max() == pytest.approx(np.array(PAPER) / max(PAPER), abs=0.15)


@pytest.mark.parametrize("light", [-120.0, -45.0, 40.0, 120.0])
def test_the_main_light_comes_from_its_azimuth(light: float, tmp_path: Path):
    path = staged(tmp_path, light=light, azimuth=20.0, elevation=10.0)
    stage = Usd.Stage.Open(str(path))
    matrix = UsdGeom.XformCache(0).GetLocalToWorldTransform(stage.GetPrimAtPath("/World/Studio/Key"))
    assert matrix.GetDeterminant3() == pytest.approx(1.0)
    x, _, z = np.array(matrix.ExtractTranslation())  # the ball is at the origin
    assert np.degrees(np.arctan2(x, z)) == pytest.approx(20.0 + light, abs=1.0)
    assert Gf.Vec3d(*matrix.GetRow3(2)) * Gf.Vec3d(x, 0.0, z) > 0.0  # a RectLight shines along its -Z
    if abs(light) < 90.0:  # else the strip light is in front
        render_stage(path, tmp_path / "ball.png", size=(160, 90), device="cpu")
        ball = np.asarray(Image.open(tmp_path / "ball.png").convert("L")).astype(float)[20:70, 45:115]
        left, right = ball[:, 10:34].mean(), ball[:, 36:60].mean()
        assert (right > left) == (light > 0.0)
