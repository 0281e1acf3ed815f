"""Lens, shutter and transparent pictures, held against geometry."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Usd
from render_stages import LATEX, add_camera, add_ground, add_mesh, add_sphere, new_stage, quad_sphere

from balloon_warp.outputs.render import render_stage
from balloon_warp.outputs.render.shutter import moments, one_over_the_other

BLACK, RED = (0.0, 0.0, 0.0), (0.8, 0.04, 0.04)
SIZE = 200


def picture(stage: Usd.Stage, **options) -> np.ndarray:
    """Return the stage's picture, sRGB, with opacity where there is any."""
    stage.GetRootLayer().Save()
    path = Path(stage.GetRootLayer().realPath)
    render_stage(path, path.with_suffix(".png"), **{"size": (SIZE, SIZE), "device": "cpu"} | options)
    return np.asarray(Image.open(path.with_suffix(".png"))).astype(int)


def darkness(pixels: np.ndarray) -> np.ndarray:
    """Return the fraction of black before the backdrop, as bright as at the right, in linear light."""
    light = (pixels[..., 1] / 255.0) ** 2.2
    return np.clip(1.0 - light / light[:, 185:190].mean(axis=1, keepdims=True), 0.0, 1.0)


def edge_width(row: np.ndarray) -> float:
    """Return the number of pixels in which darkness falls from nine tenths to one, beside the middle."""
    half = row[len(row) // 2 :]
    return float((half < 0.1).argmax() - (half < 0.9).argmax())


def test_a_lens_blurs_what_is_out_of_focus_by_as_much_as_geometry_says(tmp_path):
    """A point of a ball 10 away, with the lens focused at 5, is blurred to a disc of the lens's diameter times (10 - 5)
    / 5, as seen at 10. Of a disc's shadow over an edge nine tenths lie within 0.68 of its diameter."""
    stage = new_stage(tmp_path / "stage.usda")
    add_camera(stage, distance=10.0, focal_length=60.0, aperture=24.0)
    add_sphere(stage, "Ball", (0.0, 0.0, 0.0), 1.2, BLACK, roughness=1.0)
    widths = {}
    for focus in (0.0, 5.0):
        seen = picture(stage, aperture=0.4, focus=(0.0, 0.0, focus), samples=64, look_at=None)
        widths[focus] = np.median([edge_width(row) for row in darkness(seen)[96:104]])
    assert widths[0.0] <= 2.0
    # 50 pixels a unit there: 0.4 is 20 pixels.
    assert widths[5.0] == pytest.approx(0.68 * 20.0, abs=2.5)


def test_an_open_shutter_smears_what_moves_along_its_way(tmp_path):
    stage = new_stage(tmp_path / "stage.usda", frames=3)
    add_camera(stage, distance=10.0, focal_length=60.0, aperture=24.0)
    add_sphere(stage, "Ball", [(-1.0, 0, 0), (0.0, 0, 0), (1.0, 0, 0)], 0.2, BLACK, roughness=1.0)
    sharp, smeared = (darkness(picture(stage, frame=1, shutter=open_for)) for open_for in (0.0, 0.5))
    # 50 pixels a unit: 20 wide, and half a frame's way, 25, longer to the right; what is dark there is as much.
    columns = [np.flatnonzero(seen[100] > 0.05) for seen in (sharp, smeared)]
    assert columns[0][[0, -1]] == pytest.approx([90, 109], abs=1)
    assert columns[1][[0, -1]] == pytest.approx([90, 134], abs=4)
    assert smeared.sum() == pytest.approx(sharp.sum(), rel=0.05)


def test_the_shutter_stays_within_the_stage():
    assert moments(5, 0.0, 9) == [5]
    assert 5.0 < min(moments(5, 0.5, 9)) < max(moments(5, 0.5, 9)) < 5.5
    assert 8.5 < min(moments(9, 0.5, 9)) < max(moments(9, 0.5, 9)) < 9.0


def test_moments_add_up_as_light_does():
    black, white = np.zeros((1, 1, 3), np.uint8), np.full((1, 1, 3), 255, np.uint8)
    assert one_over_the_other([black, white])[0, 0, 0] == 188  # half of the light
    gray = np.arange(256, dtype=np.uint8).repeat(3).reshape(1, 256, 3)
    np.testing.assert_array_equal(one_over_the_other([gray, gray]), gray)
    clear, red = np.zeros((1, 1, 4), np.uint8), np.array([[[200, 0, 0, 255]]], np.uint8)
    np.testing.assert_array_equal(one_over_the_other([clear, red]), [[[200, 0, 0, 128]]])


def test_a_transparent_picture_lies_over_its_backdrop_as_if_taken_before_it(tmp_path):
    """A dark ball and a transparent balloon with alpha, over the backdrop, equal the picture taken before it."""
    stage = new_stage(tmp_path / "stage.usda")
    add_camera(stage, distance=10.0, focal_length=60.0, aperture=24.0)
    add_sphere(stage, "Ball", (-0.9, 0.0, 0.0), 0.7, BLACK, roughness=1.0)
    add_mesh(stage, "Balloon", *quad_sphere(8, 0.7, (0.9, 0.0, 0.0)), RED, **LATEX)
    whole, over = picture(stage), picture(stage, transparent=True)
    opacity = over[..., 3] / 255.0
    assert over.shape == (SIZE, SIZE, 4)
    assert opacity[100, 55] == 1.0
    assert opacity[20, 20] == opacity[180, 100] == 0.0
    assert 0.6 < opacity[100, 145] < 0.98
    # The backdrop is nearly even: without it, the pixels are what is left once its share is taken away.
    together = (
        opacity[..., None] * (over[..., :3] / 255.0) ** 2.2 + (1 - opacity[..., None]) * (whole[5, 100] / 255) ** 2.2
    )
    assert np.abs(together - (whole / 255.0) ** 2.2)[65:135].mean() < 0.02


def test_a_transparent_picture_keeps_the_shadow_on_the_ground(tmp_path):
    """A transparent picture over the ground's color equals the picture with the ground, with the red light below the
    balloon. The ground is not visible through the balloon."""
    stage = new_stage(tmp_path / "stage.usda")
    add_camera(stage, distance=10.0, focal_length=60.0, aperture=24.0)
    add_sphere(stage, "Ball", (-0.9, 0.0, 0.0), 0.5, BLACK, roughness=1.0)
    add_mesh(stage, "Balloon", *quad_sphere(8, 0.5, (0.9, 0.0, 0.0)), RED, **LATEX)
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
    # Far away the ground turns into the backdrop, 3 off; the film's curve darkens what is darkest, 10 more in 110.
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
