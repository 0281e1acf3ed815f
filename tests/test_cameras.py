"""Depth and color images of cameras in each world."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from meshes import cube, quad_sphere

from balloon_warp import Balloon, Body, Ground, Inflation, InputError, Material, Obstacle, Scene, Simulator, Sphere
from balloon_warp.steering.observations import WorldCamera

STILL = Inflation(k_normal=0.0)
FAR_BALL = Balloon(mesh=quad_sphere(2, 0.1), position=(0.0, 0.0, 90.0), inflation=STILL)
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
    return Balloon(mesh=quad_sphere(cells, RADIUS), position=tuple(center), inflation=STILL)


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
    """A capsule seen along its axis is a ball at its near end; a plane is the ground."""
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


def test_from_inside_a_balloon_its_inside_is_all_around():
    center = np.zeros(3)
    found = depths(scene(balloon=[ball(center)]), (0.0, 0.1, 0.0), (1.0, 0.2, 0.3))
    assert np.isfinite(found).all()
    assert found.min() > 0.4
    assert found.max() < RADIUS + 0.1


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
    mesh, material = quad_sphere(4, RADIUS), Material(preset="latex", strength=1e9)
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
        ({"eye": (0.0, np.nan, 1.0)}, r"eye: must be a place"),
        ({"eye": "above"}, r"eye: must be a place.*\(got above\)"),
        ({"target": EYE}, r"target: must not be where the eye is, in world 0"),
        ({"width": 0}, r"width: must be a whole number from 1 to 4096 \(got 0\)"),
        ({"height": 10.5}, r"height: must be a whole number"),
        ({"angle": 0.0}, r"angle: must be from 1 to 170 degrees \(got 0.0\)"),
        ({"angle": np.inf}, r"angle: must be from 1 to 170 degrees \(got inf\)"),
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
