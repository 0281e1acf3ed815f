"""Details that are drawn and not simulated: knots where strings are tied; outlines of coarse meshes, without gray
shards and sharp where these are sharp at the start."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from law_functions import called
from meshes import cube, mesh_of, quad_sphere
from painted import Glb
from pxr import Usd, UsdGeom, UsdShade
from scipy.spatial.transform import Rotation

from balloon_warp import Balloon, PolygonMesh, Scene, String, animate, export_stage
from balloon_warp.kernels.pictures.surfaces import LEAST_SEEN, turned_to_viewer
from balloon_warp.mesh.orientation import CREASE, SOFT_CREASE, sharp_edges
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.studio.render.sampling import SmoothSurface
from balloon_warp.studio.render.stage_reader import RenderStage
from balloon_warp.usd.solids import AROUND, PROFILE, Knot, knot_mesh, knot_size

FRAMES = 3
BALL = quad_sphere(6)
LOWEST = int(BALL.points[:, 1].argmin())
UPS = [np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])]


@pytest.mark.parametrize("up", UPS, ids=["Y", "Z"])
def test_a_knot_hangs_down_and_is_closed_but_for_its_neck(up: np.ndarray):
    mesh = knot_mesh(2.0, up)
    along = mesh.points @ -up
    assert (along.min(), along.max()) == pytest.approx((2.0 * PROFILE[:, 0].min(), 2.0 * PROFILE[:, 0].max()))
    assert np.linalg.norm(mesh.points - np.outer(mesh.points @ up, up), axis=1).max() == pytest.approx(0.076)
    # Closed across the neck, it is a row of pieces of pyramids with twelve sides, each of 3 r^2 across.
    neck = np.arange(AROUND)[::-1].astype(np.int32)
    counts, indices = np.append(mesh.face_vertex_counts, AROUND), np.append(mesh.face_vertex_indices, neck)
    (high, big), (low, small) = 2.0 * PROFILE[:-1].T, 2.0 * PROFILE[1:].T
    pieces = (low - high) * (big**2 + big * small + small**2)
    closed = PolygonMesh(mesh.points, counts.astype(np.int32), indices)
    # The funnel's end is closed by bent quads, which are 1e-6 off.
    assert signed_volume(closed) == pytest.approx(pieces.sum(), abs=2e-6)


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, 150.0, 180.0])
def test_a_knot_goes_along_its_string_as_far_as_the_balloon_lets_it(angle: float):
    """A knot points along its string as far as the balloon lets it, from 0 degrees, outward, to 180, through it."""
    up, slope = UPS[0], np.radians(angle)
    end = BALL.points[LOWEST]
    string = np.array([np.sin(slope), -np.cos(slope), 0.0])
    curve = end + np.array([1.0, 0.5, 0.0])[:, None] * string
    pose = Knot(BALL, LOWEST).pose(BALL.points, curve, up)
    np.testing.assert_array_equal(pose[:3], end)
    direction = Rotation.from_quat(pose[3:]).apply(-up)
    outward = float(direction @ -up)
    assert outward >= np.sqrt(0.5) - 1e-9
    assert direction @ string > 0.0 or angle > 135.0
    if angle in (0.0, 180.0):
        np.testing.assert_allclose(direction, -up, atol=1e-9)
    elif angle == 30.0:  # within 5 degrees of the string
        assert direction @ string > np.cos(np.radians(5.0))


@pytest.fixture(scope="module", params=["Y", "Z"])
def stage(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Usd.Stage:
    """Return a stage of four balls on strings: one knotted for a while, one of foil, one bare, one on its side."""
    path = tmp_path_factory.mktemp("knots") / "knots.usdc"

    def up(x: float, height: float) -> tuple[float, float, float]:
        return (x, height, 0.0) if request.param == "Y" else (x, 0.0, height)

    balls = [Balloon(mesh=BALL, name=f"ball{n}", position=up(4.0 * n, 2.0), helium=20.0) for n in range(4)]
    balls[1] = balls[1].model_copy(update={"look": "foil"})
    strings = [
        String(anchor=up(0.0, 0.0), end=2.0 / 60.0),
        String(anchor=up(4.0, 0.0), balloon=1),
        String(anchor=up(8.0, 0.0), balloon=2, knot=False),
        String(anchor=up(14.0, 2.0), balloon=3, particle=int(BALL.points[:, 0].argmax())),
    ]
    animate(Scene(balloon=balls, string=strings, frames=FRAMES, up_axis=request.param), path, device="cpu")
    return Usd.Stage.Open(str(path))


def test_a_stage_has_a_knot_where_a_string_is_tied(stage: Usd.Stage):
    group = stage.GetPrimAtPath("/World/Strings")
    assert [name for name in group.GetChildrenNames() if name.endswith("Knot")] == ["String_0_Knot", "String_3_Knot"]
    for number in (0, 3):
        knot = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/Strings/String_{number}_Knot"))
        curve = UsdGeom.BasisCurves(stage.GetPrimAtPath(f"/World/Strings/String_{number}"))
        ball = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/ball{number}"))
        tip = np.array(knot.GetPointsAttr().Get()).mean(axis=0)
        for frame in range(FRAMES + 1):
            matrix = np.array(knot.ComputeLocalToWorldTransform(frame))
            points = np.array(curve.GetPointsAttr().Get(frame))
            np.testing.assert_allclose(matrix[3, :3], points[-1], atol=1e-6)
            # Both strings begin straight away from the balloon, which turns little in three frames.
            outward = (points[-2] - points[-1]) / np.linalg.norm(points[-2] - points[-1])
            assert tip @ matrix[:3, :3] @ outward > 0.99 * np.linalg.norm(tip)
        bound = [UsdShade.MaterialBindingAPI(each.GetPrim()).ComputeBoundMaterial()[0] for each in (knot, ball)]
        colors = [each.ComputeSurfaceSource()[0].GetInput("diffuseColor").Get() for each in bound]
        assert colors[0] == colors[1]
    seen = [
        [UsdGeom.Imageable(stage.GetPrimAtPath(path)).ComputeVisibility(frame) != "invisible" for frame in (0, 1, 2, 3)]
        for path in ("/World/Strings/String_0_Knot", "/World/Strings/String_0")
    ]
    assert seen[0] == seen[1]  # a knot is there while its string is
    assert (seen[0][0], seen[0][-1]) == (True, False)


def test_a_knot_is_round_in_pictures_and_in_a_glb(stage: Usd.Stage, tmp_path: Path):
    """A knot has one vertex per point, none split at a crease of 40 degrees."""
    path, made = Path(stage.GetRootLayer().realPath), knot_mesh(knot_size(BALL), UPS[0])
    opened = RenderStage(path)
    opened.read_prims(0)
    knots = [mesh for mesh in opened.meshes if mesh.point_count == made.vertex_count]
    assert [knot.surface.vertex_count for knot in knots] == 2 * [SmoothSurface(made).vertex_count]
    export_stage(path, tmp_path / "out.glb")
    file = Glb(tmp_path / "out.glb")
    assert len(file.array(file.primitive("String_3_Knot")["attributes"]["POSITION"])) == made.vertex_count


def test_the_page_has_knots_where_strings_are_tied_and_none_in_hands():
    pytest.importorskip("viser")
    from balloon_warp.studio.page.drawings import Drawing, KnotLayer
    from balloon_warp.studio.page.session import Session

    session = Session("ball", Scene(balloon=[Balloon(mesh=BALL)], string=[String(anchor=(0, -3, 0))]), "cpu")
    playground, places = session.playground, dict[str, SimpleNamespace]()
    layer: Any = SimpleNamespace(add_frame=lambda *_, **__: None, remove_by_name=lambda _: places.clear())
    layer.add_mesh_simple = lambda name, *_, **__: places.setdefault(name, SimpleNamespace())
    knots = KnotLayer(cast(Any, SimpleNamespace(scene=layer)))

    def drawn() -> list[str]:
        picture = session._take_picture()
        knots.draw(picture, Drawing(picture.model).string_curves(picture))
        return list(places)

    particle = int(playground.simulator.model.string_particle.numpy()[0])
    for _ in range(2):
        assert drawn() == ["/knots/0"]
        assert places["/knots/0"].position == pytest.approx(playground.points[particle])
        playground.step()
    playground.grab("hand", 3, playground.points[3])
    assert drawn() == ["/knots/0"]
    playground.tie(5, playground.points[5] - [0.0, 0.4, 0.0])
    assert drawn() == ["/knots/0", "/knots/2"]
    playground.cut_all()
    assert drawn() == []


def test_a_smooth_normal_is_never_much_more_at_a_slant_than_its_face():
    draw = np.random.default_rng(5)
    smooth, facing, direction = (_unit(draw.normal(size=(4000, 3))) for _ in range(3))
    facing *= -np.sign(np.einsum("ij,ij->i", facing, direction))[:, None]
    smooth *= np.sign(np.einsum("ij,ij->i", smooth, facing))[:, None]
    turned = called(turned_to_viewer, {"smooth": smooth, "facing": facing, "direction": direction}, "vec3")
    least = -float(LEAST_SEEN) * np.einsum("ij,ij->i", facing, direction)
    before, after = (-np.einsum("ij,ij->i", normals, direction) for normals in (smooth, turned))
    assert np.linalg.norm(turned, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert (after >= least - 1e-5).all()
    assert np.allclose(turned[before > least], smooth[before > least], atol=1e-6)
    assert np.allclose(after[before < least], least[before < least], atol=1e-5)
    assert (before < least).mean() > 0.2
    planes = np.cross(smooth, direction)  # it turns in the plane of the ray
    assert np.abs(np.einsum("ij,ij->i", planes, turned)).max() < 1e-5


@pytest.mark.parametrize("bend", [30.0, 59.0, 61.0, 120.0])
def test_an_edge_is_sharp_beyond_its_angle(bend: float):
    x, y = np.cos(np.radians(bend)), np.sin(np.radians(bend))
    points = [(0, 0, -1), (0, 0, 1), (-1, 0, -1), (-1, 0, 1), (x, y, -1), (x, y, 1)]
    card = mesh_of(points, [[0, 2, 3, 1], [0, 1, 5, 4]])
    assert len(sharp_edges(card, SOFT_CREASE)) == (bend > SOFT_CREASE)
    assert len(sharp_edges(card, CREASE)) == (bend > CREASE)


def test_a_box_that_is_inflated_keeps_its_edges(tmp_path: Path):
    boxes = [Balloon(mesh=cube(), name="box"), Balloon(mesh=quad_sphere(3), name="ball", position=(4, 0, 0))]
    animate(Scene(balloon=boxes, frames=3, gravity=0.0), tmp_path / "out.usdc", device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    box, ball = (UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{name}")) for name in ("box", "ball"))
    edges = np.sort(np.array(box.GetCreaseIndicesAttr().Get()).reshape(-1, 2), axis=1)
    assert len(np.unique(edges, axis=0)) == len(edges) == 12
    assert list(box.GetCreaseLengthsAttr().Get()) == [2] * len(edges)
    assert set(box.GetCreaseSharpnessesAttr().Get()) == {UsdGeom.Mesh.SHARPNESS_INFINITE}
    assert not ball.GetCreaseIndicesAttr().HasAuthoredValue()
    drawn = RenderStage(tmp_path / "out.usdc")
    drawn.read_prims(3)
    sides = [len(mesh.surface._source) - mesh.point_count for mesh in drawn.meshes]
    assert sides[0] == 3 * 8 - 8
    assert sides[1] == 0


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
