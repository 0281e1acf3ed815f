"""Pictures of rubber and foil: light in thin walls and on mirrors."""

from pathlib import Path

import numpy as np
import warp as wp
from PIL import Image
from pxr import Usd
from render_stages import LATEX, add_camera, add_ground, add_mesh, add_sphere, new_stage, quad_sphere

from balloon_warp import load_scene
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.pictures.rubber import thickness_of, wall_of
from balloon_warp.outputs.render import render_stage

wp.set_module_options(OPTIONS)

RED, GREEN = (0.8, 0.04, 0.04), (0.02, 0.6, 0.05)
FOIL = {"roughness": 0.12, "metallic": 1.0}


@wp.kernel
def build_walls(
    color: wp.vec3,
    opacities: wp.array[float],
    shrunk: wp.array[float],
    facing: wp.array[float],
    # out
    clear: wp.array[wp.vec3],
    back: wp.array[wp.vec3],
    forth: wp.array[wp.vec3],
):
    number = wp.tid()
    wall = wall_of(color, thickness_of(opacities[number], shrunk[number]), facing[number])
    clear[number] = wall.clear
    back[number] = wall.back
    forth[number] = wall.forth


def walls(opacities, shrunk, facing) -> list[np.ndarray]:
    """Return the shares clear, back and forth of walls of red rubber, shape (count, 3) each."""
    rows = [wp.array(np.asarray(row), dtype=float, device="cpu") for row in (opacities, shrunk, facing)]
    shares = [wp.empty(len(opacities), dtype=wp.vec3, device="cpu") for _ in range(3)]
    wp.launch(build_walls, len(opacities), [wp.vec3(*RED), *rows], outputs=shares, device="cpu")
    return [share.numpy() for share in shares]


def picture(stage: Usd.Stage, **options) -> np.ndarray:
    """Return the stage's picture, sRGB, shape (height, width, 3)."""
    stage.GetRootLayer().Save()
    path = Path(stage.GetRootLayer().realPath)
    render_stage(path, path.with_suffix(".png"), **{"size": (160, 160), "device": "cpu"} | options)
    return np.asarray(Image.open(path.with_suffix(".png"))).astype(int)


def saturation(colors: np.ndarray) -> float:
    """Return the saturation of the mean color, sRGB: 0 for gray, 1 for a pure color."""
    mean = colors.reshape(-1, 3).mean(axis=0)
    return float(1.0 - mean.min() / mean.max())


def test_a_wall_makes_no_light_and_an_opaque_one_lets_none_through():
    many = np.random.default_rng(3)
    opacity = np.append(many.uniform(0.0, 1.0, 500), 1.0)
    clear, back, forth = walls(opacity, many.uniform(0.05, 4.0, 501), many.uniform(0.0, 1.0, 501))
    assert min(clear.min(), back.min(), forth.min()) >= 0.0
    assert (clear + back + forth).max() <= 1.0 + 1e-6
    assert (clear[-1] + forth[-1]).max() < 1e-4
    assert back[-1, 0] > 0.5


def test_color_deepens_with_the_way_through_and_fades_with_stretch():
    def redness(shares: np.ndarray) -> np.ndarray:
        return shares[:, 0] / shares[:, 1]

    facing = np.linspace(1.0, 0.05, 8)
    at_angles = walls(np.full(8, 0.92), np.ones(8), facing)[0]
    assert (np.diff(redness(at_angles)) > 0.0).all()
    assert (np.diff(at_angles[:, 0]) < 0.0).all(), "darker toward the rim"
    stretched = walls(np.full(8, 0.92), np.linspace(1.0, 0.1, 8), np.ones(8))[0]
    assert (np.diff(redness(stretched)) < 0.0).all()
    assert (np.diff(stretched[:, 0]) > 0.0).all(), "clearer, the thinner"


def test_a_stretched_balloon_is_paler_in_the_middle_than_at_its_rim_and_than_before(tmp_path):
    stage = new_stage(tmp_path / "stage.usda", frames=2)
    points, counts, indices = quad_sphere(8, 0.5)
    ball = add_mesh(stage, "Balloon", points, counts, indices, RED, **LATEX)
    for frame in range(2):  # the area is four times as large
        ball.GetPointsAttr().Set((points * (1.0 + frame)).astype(np.float32), frame)
    add_camera(stage, distance=10.0, focal_length=60.0, aperture=24.0)
    before, after = (picture(stage, frame=frame) for frame in range(2))
    middle = slice(76, 84)
    assert saturation(after[middle, middle]) < saturation(before[middle, middle]) - 0.1
    # Its radius is 1 of the 2 that half of the picture is at its place, 40 pixels: the rim is at 39 of them.
    assert saturation(after[79:81, 42:44]) > saturation(after[middle, middle]) + 0.05


def test_rubber_tints_its_shadow_and_an_opaque_ball_does_not(tmp_path):
    tints = []
    for opacity in (0.92, 1.0):
        stage = new_stage(tmp_path / f"{opacity}.usda")
        add_ground(stage, color=(0.7, 0.7, 0.7))
        add_mesh(stage, "Balloon", *quad_sphere(6, 1.0, (0.0, 3.0, 0.0)), RED, **LATEX | {"opacity": opacity})
        for side in (-4.0, 4.0):  # which the picture is as wide as
            add_sphere(stage, f"Side_{side > 0}", (side, 0.0, 0.0), 0.01, RED)
        seen = picture(stage, azimuth=0.0, elevation=90.0)
        # The key light comes from (-0.62, 1, 0.62): three times as far the other way is the middle of the shadow, at 16
        # pixels a unit.
        shade = seen[47:53, 107:113].mean(axis=(0, 1))
        tints.append(shade[0] - shade[1])
    assert tints[0] > tints[1] + 25
    assert abs(tints[1]) < 20


def test_foil_mirrors_what_is_beside_it_and_lets_nothing_through(tmp_path):
    seen = {}
    for beside in (GREEN, None):
        for behind in (RED, None):
            stage = new_stage(tmp_path / f"{beside is None}{behind is None}.usda")
            add_camera(stage, distance=10.0, focal_length=60.0, aperture=24.0)
            add_mesh(stage, "Foil", *quad_sphere(8, 0.8, (-0.6, 0.0, 0.0)), (0.9, 0.9, 0.9), **FOIL)
            if behind:
                add_sphere(stage, "Behind", (-0.6, 0.0, -1.5), 0.5, RED, roughness=1.0)
            if beside:
                add_sphere(stage, "Beside", (0.9, 0.0, 0.0), 0.6, GREEN, roughness=1.0)
            seen[beside, behind] = picture(stage)
    plain = seen[None, None]
    # The action is larger with the ball behind, so that round-off differs.
    assert np.abs(seen[None, RED] - plain)[64:96, 40:72].max() <= 2
    # Its right half, columns 56 to 88, mirrors the ball.
    greener = seen[GREEN, None][60:100, 66:86] - plain[60:100, 66:86]
    assert (greener[..., 1] - greener[..., 0]).max() > 40


def test_materials_look_like_what_they_are_unless_said():
    looks = {
        preset: load_scene("latex_inflate", {"balloon.0.material.preset": preset}).balloon[0].looks_like
        for preset in ("latex", "foil")
    }
    assert looks == {"latex": "latex", "foil": "foil"}
    assert load_scene("latex_inflate", {"balloon.0.look": "foil"}).balloon[0].looks_like == "foil"
