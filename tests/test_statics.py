"""Stiffness of an equilibrium, relaxation, and springs and rest shapes from files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sparse
from meshes import quad_sphere

import balloon_warp as bw
from balloon_warp import InputError, PolygonMesh
from balloon_warp.lab import statics as systems
from balloon_warp.lab.statics import Balance, SealedGas, Volume, film_of, springs_of
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene.write import write_scene

EGG = replace(quad_sphere(3), points=0.2 * quad_sphere(3).points * [1.0, 0.8, 1.3])
MATERIALS = {
    "springs": bw.Material(),
    "latex": bw.Material(preset="latex"),
    "gent": bw.Material(kind="gent", gent_limit=30.0),
    "without wrinkles": bw.Material(preset="latex", wrinkling=False),
}
KINDS = ("structural", "shear", "flexion")


def gas_scene(mesh, material: bw.Material = MATERIALS["springs"], **of_balloon) -> bw.Scene:
    inflation = bw.Inflation(moles=1.0, fill_time=0.1, added_mass=0.0, molar_mass=0.0)
    balloon = bw.Balloon(mesh=mesh, damping=2.0, material=material, inflation=inflation, parts="free", **of_balloon)
    return bw.Scene(balloon=[balloon], gravity=0.0)


def balance_of(simulator: bw.Simulator) -> Balance:
    """Return the equilibrium problem of a simulator's balloon, on the host."""
    model, frame = simulator.model, simulator.read_frame()
    shape, rows = model.shapes[0], {name: values.numpy() for name, values in model.parameters.items()}
    constants = np.array([float(rows[kind][0, 0]) for kind in KINDS])
    skin = film_of(model.scene, 0, shape, rows) if shape.membrane.count else springs_of(shape, constants)
    return Balance(skin, Volume(shape.mesh), SealedGas(float(frame.gas_amounts[0]), 293.15, 101325.0))


@pytest.mark.full
@pytest.mark.parametrize("name", MATERIALS)
def test_statics_are_those_of_what_is_simulated(name: str):
    simulator = bw.Simulator(gas_scene(EGG, MATERIALS[name]), "cpu")
    points = simulator.relax(1.0e-4).points[0].astype(float)
    balance, way = balance_of(simulator), np.random.default_rng(0).standard_normal(EGG.points.shape)
    assert balance.left_over(points) < 2.0e-3
    felt = (balance.forces(points + 1e-7 * way) - balance.forces(points - 1e-7 * way)) / 2e-7
    told = (simulator.stiffness() @ way.ravel()).reshape(-1, 3)
    assert np.linalg.norm(felt + told) < 2e-4 * np.linalg.norm(told)  # the pressure was read in float32
    settled = balance.settle(EGG.points * 1.2)
    assert settled is not None
    assert np.linalg.norm(settled - settled.mean(0) - points + points.mean(0), axis=1).max() < 1e-3


def test_a_singular_matrix_gets_an_answer():
    """A singular matrix is solved where it has stiffness: coarse meshes may have displacements that nothing resists."""
    matrix = sparse.diags([2.0, 0.0, 4.0], format="csc")
    np.testing.assert_allclose(systems.solver_of(matrix)(np.array([2.0, 0.0, 4.0])), [1.0, 0.0, 1.0], rtol=1e-9)


def test_what_still_moves_is_not_called_at_rest():
    simulator = bw.Simulator(gas_scene(EGG), "cpu")
    with pytest.raises(InputError, match=r"fastest particle still moves at .* after 0.05 s"):
        simulator.relax(1.0e-6, most_seconds=0.05)
    with pytest.raises(InputError, match="speed: must be above 0"):
        simulator.relax(0.0)


def write_springs(path: Path, **changed) -> Path:
    springs = bw.build_springs(EGG)
    table = {"pairs": springs.pairs, "rest_lengths": springs.rest_lengths, "constants": np.full(springs.count, 30.0)}
    np.savez(path, **(table | changed))
    return path


def test_springs_of_a_file_are_those_that_act(tmp_path: Path):
    springs = bw.build_springs(EGG)
    order = np.random.default_rng(1).permutation(springs.count)
    lengths, constants = 0.5 * springs.rest_lengths, 10.0 + np.arange(springs.count) % 7
    table = {"pairs": springs.pairs[:, ::-1], "rest_lengths": lengths, "constants": constants}
    file = write_springs(tmp_path / "springs.npz", **{name: each[order] for name, each in table.items()})
    scene = bw.load_scene(gas_scene(EGG, springs=file), {"balloon.scale": 2.0})
    shape = bw.Simulator(scene, "cpu").model.shapes[0]
    assert (shape.springs.pairs == springs.pairs).all()
    np.testing.assert_allclose(shape.springs.rest_lengths, 2.0 * lengths)
    of_kind = np.array([20.0, 10.0, 2.0])[shape.springs.kind]
    np.testing.assert_allclose(shape.stiffness_scale * of_kind, constants)
    write_obj(tmp_path / "egg.obj", EGG)
    (tmp_path / "out").mkdir()
    saved = bw.load_scene(scene, {"balloon.mesh": str(tmp_path / "egg.obj")})
    write_scene(saved, tmp_path / "out" / "scene.toml")
    assert 'springs = "../springs.npz"' in (tmp_path / "out" / "scene.toml").read_text()
    read = bw.load_scene(tmp_path / "out" / "scene.toml").balloon[0].springs
    assert read
    assert read.resolve() == file.resolve()


def refused(sentence: str, material: bw.Material = MATERIALS["springs"], **of_balloon) -> None:
    with pytest.raises(InputError, match=sentence):
        bw.Simulator(gas_scene(EGG, material, **of_balloon), "cpu")


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"pairs": [[0, 1]]}, "expected pairs of shape"),
        ({"pairs": "none"}, "expected a .npz file with pairs"),
        ({"constants": -1.0}, "constants: expected numbers of at least 0"),
        ({"rest_lengths": np.nan}, "rest_lengths: expected numbers"),
    ],
)
def test_a_file_that_says_no_springs_is_refused(changed: dict, sentence: str, tmp_path: Path):
    count = bw.build_springs(EGG).count
    table = {name: np.full(count, value) if isinstance(value, float) else value for name, value in changed.items()}
    refused(sentence, springs=write_springs(tmp_path / "springs.npz", **table))
    refused(r"none.npz: no such file", springs=tmp_path / "none.npz")
    springs = write_springs(tmp_path / "springs.npz")
    refused(r'needs material.kind = "springs" \(got "mooney_rivlin"\)', MATERIALS["latex"], springs=springs)


@pytest.mark.parametrize("material", [bw.Material(), bw.Material(preset="latex")])
def test_nothing_pulls_in_the_rest_shape(material: bw.Material, tmp_path: Path):
    """A balloon larger than its mould shrinks to it; a film, which nothing else spreads, under a slight pressure."""
    write_obj(tmp_path / "mould.obj", EGG)
    larger = replace(EGG, points=1.1 * EGG.points)
    there = bw.Material(**{"rest_mesh": tmp_path / "mould.obj", **material.model_dump(exclude_unset=True)})
    slight = bw.Inflation(pressure=20.0 * material.is_membrane)
    balloon = bw.Balloon(mesh=larger, material=there, damping=0.5, inflation=slight)
    simulator = bw.Simulator(bw.Scene(balloon=[balloon], gravity=0.0), "cpu")
    points = simulator.relax(1e-4).points[0]
    edges = bw.build_springs(EGG)
    now = np.linalg.norm(points[edges.pairs[:, 1]] - points[edges.pairs[:, 0]], axis=1)
    np.testing.assert_allclose(now, edges.rest_lengths, rtol=5e-2)


def cut_egg() -> PolygonMesh:
    """Return the faces of the egg, each with corners of its own, lying beside each other."""
    quads = EGG.points[EGG.face_vertex_indices].reshape(-1, 4, 3)
    aside = quads + 0.3 * np.arange(len(quads))[:, None, None]
    indices = np.arange(4 * len(quads), dtype=np.int32)
    return PolygonMesh(aside.reshape(-1, 3), EGG.face_vertex_counts, indices, "panels")


def test_panels_that_are_sewn_are_what_they_were_before(tmp_path: Path):
    write_obj(tmp_path / "panels.obj", cut_egg())
    cut = bw.Simulator(gas_scene(EGG, bw.Material(preset="latex", rest_mesh=tmp_path / "panels.obj")), "cpu")
    whole = bw.Simulator(gas_scene(EGG, MATERIALS["latex"]), "cpu")
    ours, theirs = cut.model.shapes[0], whole.model.shapes[0]
    assert (ours.membrane.corners == theirs.membrane.corners).all()
    np.testing.assert_allclose(ours.membrane.rests, theirs.membrane.rests, rtol=1e-5)
    np.testing.assert_allclose(ours.mass_share, theirs.mass_share, rtol=1e-5)
    assert cut.model.substeps == whole.model.substeps


def test_a_rest_shape_of_other_vertices_or_faces_is_refused(tmp_path: Path):
    cut = cut_egg()
    sewn_wrong = replace(cut, face_vertex_indices=np.r_[0, 0, cut.face_vertex_indices[2:]].astype(np.int32))
    for mesh, sentence in (
        (replace(cut, face_vertex_counts=cut.face_vertex_counts[1:], face_vertex_indices=cut.face_vertex_indices[4:]),
         r"53 faces; expected the 56 of .*, or panels: its 54 faces, in its order"),
        (sewn_wrong, "vertex 1 of .*, counted from 1, would be sewn to several"),
    ):  # fmt: skip
        write_obj(tmp_path / "panels.obj", mesh)
        refused(sentence, bw.Material(preset="latex", rest_mesh=tmp_path / "panels.obj"))
    refused("has 216 vertices; expected the 56 of", bw.Material(rest_mesh=tmp_path / "panels.obj"))
    write_obj(tmp_path / "other.obj", quad_sphere(4))
    of_other = r"material.rest_mesh: .*other.obj has 98 vertices; expected the 56"
    refused(of_other, bw.Material(rest_mesh=tmp_path / "other.obj"))


def test_thicker_rubber_pulls_as_its_derivatives_say():
    scene = gas_scene(EGG, MATERIALS["latex"])
    simulator = bw.Simulator(scene, "cpu")
    rows = {name: values.numpy() for name, values in simulator.model.parameters.items()}
    film, points = film_of(scene, 0, simulator.model.shapes[0], rows), 1.3 * EGG.points * [1.0, 0.7, 1.1]
    way = np.random.default_rng(3).uniform(-0.5, 0.5, EGG.vertex_count)
    felt = film.with_weights(1.0 + way).forces(points) - film.with_weights(1.0 - way).forces(points)
    told = 2.0 * film.forces_by_weights(points) @ way
    np.testing.assert_allclose(told, felt.ravel(), atol=1e-12 * np.abs(felt).max() + 1e-15)
