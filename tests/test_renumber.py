"""Particles in another order, in which a block's threads have them: the same balloon, with less to wait for."""

import numpy as np
import pytest
from meshes import grid, quad_sphere

from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import Model, build_model
from balloon_warp.scene import Balloon, Scene, String, bundled_scenes, load_scene
from balloon_warp.schedules.banks import BANKS, spread_over_lanes
from balloon_warp.schedules.renumber import order_by_springs, renumbered
from balloon_warp.schedules.spring_ends import neighbors_in_slots, spring_ends


def model_of(*meshes: PolygonMesh) -> Model:
    balloons = [Balloon(mesh=mesh, position=(3.0 * number, 0.0, 0.0)) for number, mesh in enumerate(meshes)]
    return build_model(Scene(balloon=balloons, string=[String(anchor=(0.0, 0.0, 0.0), particle=7)]), "cpu")


def wavefronts(order: np.ndarray, neighbors: np.ndarray) -> int:
    """Particles in the fullest bank, over all loads of full warps."""
    bank = np.empty(len(order), dtype=np.int64)
    bank[order] = np.arange(len(order)) % BANKS
    total = 0
    for warp in order[: len(order) // BANKS * BANKS].reshape(-1, BANKS):
        for slot in neighbors[:, warp]:
            read = np.unique(slot[slot >= 0])
            total += np.bincount(bank[read], minlength=BANKS).max() if len(read) else 0
    return int(total)


def test_it_is_the_same_network():
    """Springs, faces and strings join the same particles, and balloons stay together."""
    model = model_of(quad_sphere(4), grid(5, 4))
    order = order_by_springs(model, spring_ends(model))
    other = renumbered(model, order)
    assert sorted(order) == list(range(model.particle_count))
    np.testing.assert_array_equal(model.particle_balloon.numpy()[order], model.particle_balloon.numpy())
    for name in ("spring_particles", "face_particles", "string_particle"):
        np.testing.assert_array_equal(order[getattr(other, name).numpy()], getattr(model, name).numpy())
    np.testing.assert_array_equal(other.initial_points.numpy(), model.initial_points.numpy()[order])
    offsets, faces = model.particle_face_offsets.numpy(), model.particle_faces.numpy()
    for place, particle in enumerate(order):
        begin, end = other.particle_face_offsets.numpy()[place : place + 2]
        np.testing.assert_array_equal(
            other.particle_faces.numpy()[begin:end], faces[offsets[particle] : offsets[particle + 1]]
        )
    placed = np.concatenate([shape.mesh.points[shape.mesh.face_vertex_indices] for shape in other.shapes])
    as_it_was = np.concatenate([shape.mesh.points[shape.mesh.face_vertex_indices] for shape in model.shapes])
    np.testing.assert_array_equal(placed, as_it_was)


@pytest.mark.parametrize("name", [name for name in bundled_scenes() if name.startswith("squirrel_inf")])
def test_threads_of_a_warp_have_as_many_springs_and_meet_in_few_banks(name: str):
    """On a bundled balloon of many valences: of what the longest of each warp's threads does, nine tenths are done by
    all; and the loads take less than four fifths of the wavefronts that the same order takes unspread."""
    model = build_model(load_scene(name), "cpu")
    ends = spring_ends(model)
    order = order_by_springs(model, ends)
    whole = len(order) // BANKS * BANKS
    for kind in (0, 2):
        springs = ends.by_kind[order[:whole], kind].reshape(-1, BANKS)
        assert springs.sum() > 0.9 * BANKS * springs.max(axis=1).sum()
    neighbors = np.concatenate([neighbors_in_slots(ends, kind) for kind in range(3)])
    structural, shear, flexion = ends.by_kind.T
    unspread = np.lexsort([flexion, shear, structural])
    spread = spread_over_lanes(unspread, neighbors)
    np.testing.assert_array_equal(
        np.sort(spread[:whole].reshape(-1, BANKS)), np.sort(unspread[:whole].reshape(-1, BANKS))
    )
    np.testing.assert_array_equal(spread[whole:], unspread[whole:])
    assert wavefronts(spread, neighbors) < 0.8 * wavefronts(unspread, neighbors)


def test_few_particles_stay_as_they_are():
    order = np.arange(20)[::-1].copy()
    np.testing.assert_array_equal(spread_over_lanes(order, np.zeros((3, 20), dtype=np.int64)), order)
