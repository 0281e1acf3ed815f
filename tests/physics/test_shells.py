"""Faces that a pressure pushes, and their side: those between inside and outside, however a mesh is wound."""

from dataclasses import replace

import numpy as np
import pytest
from conserved import advanced
from meshes import cube, grid, joined, open_cube, quad_sphere
from odd_meshes import band, box, chair, finned, klein, two_at_an_edge, walled
from odd_things import ODD, car, hair, haired

from balloon_warp import Balloon, Inflation, PolygonMesh, Scene, Simulator, load_scene
from balloon_warp.mesh.load import Treatment, prepared
from balloon_warp.mesh.orientation import pushed_outward, pushes, there_and_back
from balloon_warp.mesh.topology import face_vector_areas, flipped, is_closed, mesh_edges, signed_volume
from balloon_warp.model.shape import BalloonShape, shape_balloon


def shape_of(mesh: PolygonMesh, **fields: object) -> BalloonShape:
    balloon = Balloon(mesh=mesh, **fields)
    return shape_balloon(balloon, Scene(balloon=[balloon]))


def pushed(mesh: PolygonMesh) -> np.ndarray:
    return pushes(mesh, mesh_edges(mesh))


def test_faces_between_inside_and_outside_are_pushed() -> None:
    for make, expected in ((cube, 1), (open_cube, 0), (band, 0), (klein, 0), (two_at_an_edge, 1)):
        assert (pushed(make()) == expected).all(), make.__name__
    ball = quad_sphere(8).face_count
    np.testing.assert_array_equal(pushed(finned()), np.repeat([1, 0], [ball, finned().face_count - ball]))


def test_a_wall_between_rooms_is_not_pushed() -> None:
    mesh = walled()
    middles = mesh.points[mesh.face_vertex_indices.reshape(-1, 4)].mean(axis=1)
    np.testing.assert_array_equal(pushed(mesh) == 0, np.abs(middles[:, 0]) < 1e-9)


@pytest.mark.parametrize("make", [walled, two_at_an_edge, lambda: chair(holes=False, mixed=False)])
def test_winding_does_not_matter(make) -> None:
    mesh = prepared(make(), "mesh", Treatment())
    wild = flipped(make(), np.random.default_rng(2).random(make().face_count) < 0.4)
    again, slack = pushed_outward(prepared(wild, "mesh", Treatment()))
    np.testing.assert_array_equal(slack, pushed(mesh) == 0)
    same = face_vector_areas(mesh)[~slack]
    np.testing.assert_allclose(face_vector_areas(again)[~slack], same, atol=1e-12)
    # that of boxes side by side
    boxes = signed_volume(there_and_back(again, slack))
    assert boxes == pytest.approx({"walled": 1.0, "two_at_an_edge": 0.25}.get(make.__name__, 0.02225), rel=1e-9)


def test_missing_faces_of_a_chair_are_closed_and_it_is_inflated() -> None:
    whole, spoiled = (shape_of(chair(holes=holes, mixed=holes)) for holes in (False, True))
    assert np.count_nonzero(spoiled.slack) == np.count_nonzero(whole.slack) > 0
    assert signed_volume(spoiled.skin) == pytest.approx(signed_volume(whole.skin), rel=0.01)


@pytest.mark.parametrize("name", ODD)
def test_what_is_pushed_goes_all_around_something(name: str) -> None:
    """Pushed faces form a closed surface, so that a pressure has no net force and is the gradient of a volume."""
    shape = shape_of(ODD[name]())
    if shape.flies_off:
        assert any("not inflated" in remark.lower() for remark in shape.remarks)
        return
    edges = mesh_edges(shape.skin)
    assert is_closed(edges)
    forward = np.add.reduceat(edges.forward, edges.starts, dtype=np.int64)
    assert (2 * forward == edges.face_counts).all()
    size = np.ptp(shape.mesh.points, axis=0).max()
    assert np.abs(face_vector_areas(shape.skin).sum(axis=0)).max() < 1e-9 * size**2


def test_a_face_there_and_back_has_the_same_vertices_and_no_area() -> None:
    mesh = cube()
    folded = there_and_back(mesh, np.arange(6) == 2)
    assert folded.face_vertex_counts.tolist() == [4, 4, 6, 4, 4, 4]
    assert sorted(set(folded.face_vertex_indices[8:14])) == sorted(set(mesh.face_vertex_indices[8:12]))
    assert np.abs(face_vector_areas(folded)[2]).max() == 0.0
    without_it = np.delete(np.arange(6), 2)
    np.testing.assert_array_equal(face_vector_areas(folded)[without_it], face_vector_areas(mesh)[without_it])


def test_a_border_that_is_held_parts_inside_from_outside() -> None:
    border = [n for n in range(25) if not (0 < n % 5 < 4 and 0 < n // 5 < 4)]
    assert not shape_of(grid(4, 4), fixed=border).slack.any()
    assert shape_of(grid(4, 4), fixed=border[1:]).flies_off


def test_a_pressure_that_is_said_pushes_a_sheet() -> None:
    assert not shape_of(grid(4, 4), inflation=Inflation(pressure=5.0)).slack.any()
    assert shape_of(finned(), inflation=Inflation(pressure=5.0)).slack.any()
    assert not shape_of(finned(), inflation=Inflation(k_normal=1.0)).slack.any()


CALM = [chair, finned, klein, band, lambda: hair(40), haired, car, lambda: ODD["t_junction"]()]


@pytest.mark.always("cpu-finned")
@pytest.mark.parametrize("make", CALM)
def test_an_odd_mesh_by_itself_calms_down(make, device: str) -> None:
    """An odd mesh by itself comes to rest within 4 s; a push without a potential drove hair at 90 m/s."""
    simulator = Simulator(load_scene(make()), device, schedule="scatter")
    assert np.linalg.norm(advanced(simulator, 120).velocities[0], axis=1).max() < 1.0


def test_open_parts_beside_closed_ones_are_named_and_carried() -> None:
    shape = shape_of(car())
    assert np.count_nonzero(shape.slack) == 18
    sentence = next(remark for remark in shape.remarks if "carried along" in remark)
    assert sentence.startswith("A part of 18 of its 1,562 faces (at vertex 1603, counting from 1) is open, like a pane")
    groups = {"windshield": np.arange(1602, 1630, dtype=np.int32), "car": np.arange(1630, dtype=np.int32)}
    named = shape_of(replace(car(), groups=groups))
    assert any("(windshield, at vertex 1603" in remark for remark in named.remarks)


def test_what_is_advised_works() -> None:
    for mesh in (grid(4, 4), klein()):
        assert "--set balloon.inflation.pressure=100" in shape_of(mesh).remarks[0]
        said = load_scene(mesh, {"balloon.inflation.pressure": 100})
        assert not shape_balloon(said.balloon[0], said).slack.any()
    windshield = next(remark for remark in shape_of(car()).remarks if "--parts closed" in remark)
    assert windshield
    assert shape_of(car(), taken="closed").remarks == ()


def test_remesh_is_not_advised_for_hair() -> None:
    for mesh in (hair(20), haired()):
        assert not [remark for remark in shape_of(mesh).remarks if "remesh" in remark]
    assert "remesh" in shape_of(grid(4, 4)).remarks[0]
    assert any("remesh" in remark for remark in shape_of(car()).remarks)


def test_a_mesh_whose_z_is_up_stands_once_it_is_turned() -> None:
    told = load_scene(ODD["table"]())
    turned = load_scene(replace(ODD["table"](), up_axis="Y"), {"balloon.rotation": [-90, 0, 0]})
    assert (told.up_axis, turned.up_axis) == ("Z", "Y")
    for scene, axis in ((told, 2), (turned, 1)):
        heights = shape_balloon(scene.balloon[0], scene).mesh.points[:, axis]
        assert np.ptp(heights) == pytest.approx(0.73)
        assert scene.ground is not None
        assert scene.ground.height == pytest.approx(heights.min() - 0.05)


def test_it_is_open_is_said_of_what_has_a_border_alone() -> None:
    said = {name: " ".join(shape_of(mesh).remarks) for name, mesh in (("bottle", klein()), ("sheet", grid(4, 4)))}
    assert "open" not in said["bottle"]
    assert "is open" in said["sheet"]
    assert shape_of(joined(box((0, 0, 0), (1, 1, 1)), box((2, 0, 0), (1, 1, 1)))).remarks == ()
