"""Skins of rubber and film: masses, thickness, presets, differences between worlds, and refusals."""

from typing import Any

import numpy as np
import pytest
from conserved import advanced, put
from meshes import grid, mesh_of, quad_sphere

from balloon_warp import Balloon, Change, Inflation, InputError, Material, Scene, Simulator, load_scene
from balloon_warp.batch.recorder import MEASURES, Recorder
from balloon_warp.mesh.topology import total_area
from balloon_warp.model import build_model, plan_model
from balloon_warp.scene.load import override_scene

OGDEN = {"preset": "natural_rubber_treloar"}
UNSTABLE = {"ogden_moduli": (1e5, -1e3, 0.0), "ogden_exponents": (2.0, 2.0, 1.0)}


def latex(**fields: Any) -> Scene:
    return Scene(balloon=[Balloon(**{"mesh": quad_sphere(3, 0.1), "material": Material(preset="latex")} | fields)])


def test_the_mass_is_that_of_the_skin():
    scene = latex()
    plan = plan_model(scene, 2, {"balloon.material.thickness": [1e-4, 3e-4]})
    area = total_area(plan.shapes[0].mesh)
    # a quad that is not flat is as large as its two triangulations are on average, and so a little larger
    np.testing.assert_allclose(plan.parameters["mass"][:, 0], [area * 1e-4 * 940.0, area * 3e-4 * 940.0], rtol=2e-3)
    np.testing.assert_allclose(plan.shapes[0].mass_share.sum(), 1.0)
    fixed = plan_model(latex(fixed=[0])).shapes[0].mass_share
    np.testing.assert_allclose(fixed[1:], plan.shapes[0].mass_share[1:])  # a fixed particle keeps its own
    assert fixed[0] == 0.0


def test_mass_is_lumped_by_area_and_not_by_particles():
    strip = mesh_of([(0, 0, 0), (3, 0, 0), (4, 0, 0), (4, 1, 0), (3, 1, 0), (0, 1, 0)], [[0, 1, 4, 5], [1, 2, 3, 4]])
    shares = plan_model(latex(mesh=strip, inflation=Inflation(pressure=0.0))).shapes[0].mass_share
    np.testing.assert_allclose(shares, np.array([3.0, 4.0, 1.0, 1.0, 4.0, 3.0]) / 16.0)


def test_weights_make_the_skin_thicker():
    """Twice everywhere is a skin of twice the thickness; a function of points acts by its values."""
    points = quad_sphere(3, 0.1).points
    twice = latex(material=Material(preset="latex", weights=[2.0] * len(points)))
    thick = latex(material=Material(preset="latex", thickness=4e-4))
    rule = {"preset": "latex", "weights": lambda points: np.where(points[:, 1] > 0.0, 3.0, 1.0)}
    by_rule = latex(material=rule)
    assert latex(material=Material(**rule)).balloon[0].material == by_rule.balloon[0].material
    masses = [plan_model(scene).parameters["mass"].item() for scene in (twice, thick, by_rule, latex())]
    assert masses[0] == pytest.approx(masses[1])
    assert 1.6 * masses[3] < masses[2] < 2.4 * masses[3]
    one, other = (advanced(Simulator(scene, "cpu"), 3).points[0] for scene in (twice, thick))
    np.testing.assert_allclose(one, other, atol=1e-4)
    assert np.abs(one - points).max() > 1e-3


def test_rubber_has_no_springs_but_those_that_are_asked_for():
    assert build_model(latex(), "cpu").spring_count == 0
    asked = build_model(latex(material=Material(preset="latex", springs=["flexion"])), "cpu")
    of_springs = build_model(latex(material=Material()), "cpu")
    kinds = of_springs.spring_kind.numpy()
    assert asked.spring_count == (kinds == 2).sum() > 0
    assert of_springs.triangle_count == 0


def test_worlds_differ_in_all_that_a_material_has():
    paths = {"shear_modulus": [2e5, 4e5], "thickness": [1e-4, 2e-4], "mooney_ratio": [0.0, 0.2], "wrinkling": [0, 1]}
    for field, values in paths.items():
        scene = latex(inflation=Inflation(pressure=500.0))
        simulator = Simulator(scene, "cpu", 2, {f"balloon.material.{field}": values})
        put(simulator, simulator.state.points.numpy()[0] * (1.4, 1.0, 0.7))
        simulator.step()
        points = simulator.state.points.numpy()
        assert np.abs(points[0] - points[1]).max() > 1e-5, field


@pytest.mark.parametrize("material", [Material(**OGDEN), Material(**OGDEN, wrinkling=False)])
def test_worlds_differ_in_one_term_of_an_ogden_material(material: Material):
    vary = {"balloon.material.ogden_moduli.0": [5e5, 7e5], "balloon.material.ogden_exponents.1": [4.0, 5.0]}
    parameters = plan_model(latex(material=material), 2, vary).parameters
    moduli, exponents = parameters["ogden_moduli"][:, 0], parameters["ogden_exponents"][:, 0]
    np.testing.assert_allclose(moduli, [(5e5, 1.2e3, -1e4), (7e5, 1.2e3, -1e4)])
    np.testing.assert_allclose(exponents, [(1.3, 4.0, -2.0), (1.3, 5.0, -2.0)])


@pytest.mark.parametrize(
    ("material", "sentence"),
    [
        ({"kind": "ogden"}, "material.ogden_exponents: is missing"),
        ({"kind": "ogden", **UNSTABLE}, "material.ogden_moduli: .* unstable material; expected modulus times exponent"),
        (OGDEN | {"ogden_exponents": (1.3, 300.0, -2.0)}, r"material.ogden_exponents.1: must be less .* 20 \(got 300"),
        ({"kind": "neo_hookean", "thickness": 0.0}, r"material.thickness: must be greater than .* \(got 0"),
        ({"kind": "neo_hookean", "shear_modulus": -1.0}, r"material.shear_modulus: must be greater .* \(got -1"),
        ({"kind": "mooney_rivlin", "mooney_ratio": -0.1}, "material.mooney_ratio: must be greater than or equal to 0"),
        ({"kind": "gent", "gent_limit": 0.0}, "material.gent_limit: must be greater than 0"),
        ({"kind": "gent", "gent_limit": 20.0, "most_stretch": 5.0}, "material.most_stretch: 5 exceeds the .* 3.39"),
        ({"shear_modulus": 1e5}, 'material.shear_modulus: needs kind = "neo_hookean" or'),
        ({"thickness": 1e-3}, "material.thickness: needs a preset, or a kind such as"),
        ({"kind": "gent", "mooney_ratio": 0.2}, 'material.mooney_ratio: needs kind = "mooney_rivlin"'),
        ({"preset": "lead"}, "material.preset: must be 'latex'"),
        ({"kind": "neo_hookean", "weights": [1.0, 2.0]}, "material.weights: .* has 56 vertices; expected a number for"),
        ({"kind": "neo_hookean", "weights": {"neck": 2.0}}, "material.weights: .* has no group neck"),
        ({"kind": "neo_hookean", "weights": [0.0] * 56}, "material.weights.0: must be greater than 0"),
    ],
)
def test_bad_input_gets_a_sentence(material: dict[str, Any], sentence: str):
    with pytest.raises(InputError, match=sentence):
        build_model(latex(material=material), "cpu")


THICKER = Change(time=0.1, set={"balloon.material.thickness": 1e-3})
BY_NORMALS = Inflation(k_normal=0.1)


@pytest.mark.parametrize(
    ("balloon", "scene", "vary", "sentence"),
    [
        ({"mass": 2.0}, {}, {}, r"balloon.mass: follows from the material's thickness and density \(got 2\)"),
        ({"inflation": BY_NORMALS}, {"solver": "projective"}, {}, '"projective" does not support mooney-rivlin'),
        ({"mesh": mesh_of([(0, 0, 0), (1, 0, 0)], [[0, 1]])}, {}, {}, "material: .* has no face with an area"),
        ({}, {}, {"balloon.mass": [1.0, 2.0]}, "mass: follows from the material"),
        ({}, {}, {"balloon.material.gent_limit": [50.0, 60.0]}, r'material\.gent_limit: needs kind = "gent"'),
        ({}, {"change": [THICKER]}, {}, "thickness: cannot change"),
        ({}, {"substeps": 2}, {}, "substeps: 2 are too few"),
    ],
)
def test_what_does_not_go_with_rubber_gets_a_sentence(balloon: dict, scene: dict, vary: dict, sentence: str):
    with pytest.raises(InputError, match=sentence):
        Simulator(latex(**balloon).model_copy(update=scene), "cpu", 2 if vary else 1, vary)


def test_a_preset_is_what_it_says_and_can_be_changed():
    plain = latex()
    assert plain.balloon[0].material.value("shear_modulus") == 3.3e5
    softer = override_scene(plain, [("balloon.material.shear_modulus", 1e5)])
    assert softer.balloon[0].material.value("shear_modulus") == 1e5
    assert softer.balloon[0].material.value("thickness") == 2e-4
    foil = override_scene(plain, [("balloon.material.preset", "foil")])
    assert foil.balloon[0].material.law == "neo_hookean"
    assert foil.balloon[0].material.value("thickness") == 1.2e-5
    rubber = load_scene("squirrel_inflate", {"balloon.material.preset": "latex"})
    assert rubber.balloon[0].material.is_membrane


@pytest.mark.always
def test_the_largest_stretch_is_that_of_the_skin(device: str):
    """The largest stretch in a batch's table and on the page is that of a sheet stretched askew by 1.5 and 0.9."""
    sheet = latex(mesh=grid(3, 3), inflation=Inflation(pressure=0.0))
    simulator = Simulator(sheet, device)
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    points = simulator.state.points.numpy()[0]
    put(simulator, points @ (np.array([[1.2, 0.3, 0.0], [0.3, 1.2, 0.0], [0.0, 0.0, 1.0]]) @ turn))
    measured = Recorder(simulator, np.arange(1)).read().measures[0, MEASURES.index("largest_stretch")]
    assert measured == pytest.approx(1.5, rel=1e-5)
    membrane = simulator.model.shapes[0].membrane
    np.testing.assert_allclose(membrane.stretches(simulator.state.points.numpy()[0]), 1.5, rtol=1e-5)
