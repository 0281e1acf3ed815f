"""Rings of quads around a particle give the area vectors that the faces one by one give."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from meshes import cube, grid, prism, quad_sphere, torus

from balloon_warp.kernels.loops.areas import CROSSES, cross_at_quad_corner
from balloon_warp.kernels.options import OPTIONS
from balloon_warp.kernels.phases.add import add_area_vectors_of_face
from balloon_warp.kernels.tables import Tables
from balloon_warp.kernels.working import Working
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import Model, build_model
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.schedules.features import model_features
from balloon_warp.schedules.rings import quad_rings
from balloon_warp.schedules.tables import make_tables

wp.set_module_options(OPTIONS)


@wp.kernel
def _by_faces(t: Tables, points: wp.array[wp.vec3], working: Working):  # pyright: ignore[reportGeneralTypeIssues]
    add_area_vectors_of_face(t, working, points, 0, wp.tid())


@wp.kernel
def _by_rings(
    points: wp.array[wp.vec3],
    along: wp.array2d[wp.int32],
    across: wp.array2d[wp.int32],
    area_vectors: wp.array[wp.vec3],
):
    p = wp.tid()
    count = wp.int32(0)
    for slot in range(along.shape[0]):
        count += wp.where(along[slot, p] >= 0, 1, 0)
    for slot in range(count):
        before = points[along[slot, p]] - points[p]
        opposite = points[across[slot, p]] - points[p]
        after = points[along[(slot + 1) % count, p]] - points[p]
        area_vectors[p] = area_vectors[p] + CROSSES * cross_at_quad_corner(before, opposite, after)


def model_of(mesh: PolygonMesh) -> Model:
    return build_model(Scene(balloon=[Balloon(mesh=mesh, inflation=Inflation(k_normal=0.1))]), "cpu")


@pytest.mark.parametrize("mesh", [cube(), quad_sphere(5), torus(6, 5)], ids=["cube", "ball", "torus"])
def test_rings_of_quads_that_are_not_flat(mesh):
    """Rings agree with faces for quads that are not flat, to float32's rounding of areas of order 1."""
    bent = replace(mesh, points=mesh.points + np.random.default_rng(0).uniform(-0.1, 0.1, mesh.points.shape))
    model = model_of(bent)
    rings = quad_rings(model)
    assert rings is not None
    points = wp.array(bent.points, dtype=wp.vec3, device="cpu")
    expected = wp.zeros((1, len(bent.points)), dtype=wp.vec3, device="cpu")
    found = wp.zeros(len(bent.points), dtype=wp.vec3, device="cpu")
    tables = make_tables(model, model_features(model))
    working = Working()
    working.area_vectors = expected
    wp.launch(_by_faces, model.face_count, [tables, points, working], device="cpu")
    along, across = (wp.array(part, dtype=wp.int32, device="cpu") for part in rings)
    wp.launch(_by_rings, len(bent.points), [points, along, across], [found], device="cpu")
    assert np.linalg.norm(expected.numpy()[0], axis=1).min() > 1e-3
    np.testing.assert_allclose(found.numpy(), expected.numpy()[0], rtol=0, atol=1e-6)


@pytest.mark.parametrize("mesh", [grid(3, 3), prism(5)], ids=["open", "pentagons"])
def test_what_has_no_rings(mesh):
    model = model_of(mesh)
    assert quad_rings(model) is None


@pytest.mark.parametrize("inflation", [Inflation(pressure=10.0), Inflation(k_normal=0.1)])
def test_springs_stand_in_their_own_table_beside_rings(inflation: Inflation):
    """Springs have their own table beside rings, for code that visits springs alone: a GPU reads past an empty one."""
    model = build_model(Scene(balloon=[Balloon(mesh=quad_sphere(5), inflation=inflation)]), "cpu")
    features = model_features(model)
    assert features.rings
    springs = make_tables(model, features).springs
    assert springs.valences.numpy().sum() == 2 * model.spring_count
    assert len(springs.entries) >= 2 * model.spring_count
