"""Latex under gravity: a balloon that hangs by its neck is designed for its shape while it hangs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere
from typer.testing import CliRunner

import balloon_warp as bw
from balloon_warp import InputError, PolygonMesh
from balloon_warp.cli.app import app
from balloon_warp.cli.design import Wanted
from balloon_warp.designing import design, picture
from balloon_warp.designing.hanging import DOWN, Hanging
from balloon_warp.designing.measure import Ruler
from balloon_warp.designing.proof import simulate_from_rest
from balloon_warp.designing.target import held_target_of
from balloon_warp.mesh.obj import write_obj
from balloon_warp.statics.balance import Balance
from balloon_warp.statics.of_model import film_of
from balloon_warp.statics.volume import SealedGas, Volume

HEIGHT = quad_sphere(3).points[:, 1] / quad_sphere(3).points[:, 1].max()
TOP = np.flatnonzero(HEIGHT > 0.7)
"""Ring and cap by which it hangs"""
DENSITY, SIZE = 940.0, 3.0
"""Density of latex [kg/m^3], and a size [m] at which its weight counts"""


def egg() -> PolygonMesh:
    ball = quad_sphere(3)
    return replace(ball, points=ball.points * [1.0, 1.3, 1.0], groups={"neck": TOP.astype(np.int32)}, name="egg")


def hung_scene(mesh: PolygonMesh) -> bw.Scene:
    """Return a latex balloon of air that hangs by its neck, swings little and comes to rest."""
    inflation = bw.Inflation(start_pressure=150.0, added_mass=0.0, molar_mass=0.0289652)
    material = bw.Material(preset="latex", thickness=2e-4)
    balloon = bw.Balloon(mesh=mesh, material=material, inflation=inflation, damping=10.0, fixed=TOP.tolist())
    return bw.Scene(balloon=[balloon], gravity=9.81)


def test_statics_bear_the_weight_that_is_simulated():
    mesh = replace(egg(), points=1.2 * egg().points)
    simulator = bw.Simulator(hung_scene(mesh), "cpu")
    points = simulator.relax(2e-4).points[0].astype(float)
    model, frame = simulator.model, simulator.read_frame()
    film = film_of(model.scene, 0, model.shapes[0], {name: rows.numpy() for name, rows in model.parameters.items()})
    gas, volume = SealedGas(float(frame.gas_amounts[0]), 293.15, 101325.0), Volume(replace(mesh, points=points))
    held = np.isin(np.arange(mesh.vertex_count), TOP)
    hanging = Hanging(held, 9.81 * DOWN, DENSITY)
    balance = Balance(film, volume, gas, hanging.loading(film, hanging.weight_of_air(gas, volume)))
    weightless = Hanging(held, 0.0 * DOWN, DENSITY)
    without = replace(balance, loading=weightless.loading(film, np.zeros_like(points)))
    assert balance.left_over(points) < 5e-3
    assert balance.left_over(points) < 0.1 * without.left_over(points)
    settled = balance.settle(mesh.points)
    assert settled is not None
    assert np.linalg.norm(settled - points, axis=1).max() < 2e-3
    np.testing.assert_array_equal(settled[TOP], mesh.points[TOP])


def test_the_weight_changes_with_the_mould_as_told():
    scene = hung_scene(egg())
    simulator = bw.Simulator(scene, "cpu")
    rows = {name: values.numpy() for name, values in simulator.model.parameters.items()}
    film, mould, count = film_of(scene, 0, simulator.model.shapes[0], rows), egg().points, egg().vertex_count
    assert film.volumes(count).sum() == pytest.approx(2e-4 * simulator.model.shapes[0].membrane.areas.sum())
    way = np.random.default_rng(0).standard_normal(mould.shape)
    felt = [film.with_mould(mould + sign * 1e-6 * way).volumes(count) for sign in (1.0, -1.0)]
    told = film.volumes_by_mould(count) @ way.ravel()
    np.testing.assert_allclose(told, (felt[0] - felt[1]) / 2e-6, atol=1e-6 * np.abs(told).max())
    thicker = np.random.default_rng(1).uniform(0.0, 0.5, count)
    felt = film.with_weights(1.0 + thicker).volumes(count) - film.volumes(count)
    np.testing.assert_allclose(film.volumes_by_weights(count) @ thicker, felt, rtol=1e-9)


def test_what_hangs_becomes_the_shape_under_its_gravity(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(picture, "SIZE", (96, 84))
    design = bw.design(egg(), of="latex", stretch=1.3, size=SIZE, gravity=9.81, steps=8, folder=tmp_path, device="cpu")
    ruler = Ruler(held_target_of(egg(), SIZE, None)[0], in_place=True)
    frames = list(bw.Simulator(tmp_path / "balloon.toml", "cpu").run())
    reached = ruler.error(frames[-1].points[0].astype(float))
    assert reached.mean == pytest.approx(design.error.mean, abs=1e-4)
    assert design.error.mean < 1e-3
    assert design.plain_error
    assert design.error.mean < 0.1 * design.plain_error.mean
    np.testing.assert_allclose(frames[0].points[0][TOP], ruler.mesh.points[TOP], atol=1e-5)
    scene = bw.load_scene(tmp_path / "balloon.toml")
    assert scene.gravity == 9.81
    assert scene.balloon[0].fixed == TOP.tolist()
    floating = simulate_from_rest(bw.load_scene(scene, {"gravity": 0.0}), SIZE, "cpu")
    assert not isinstance(floating, str)
    assert ruler.error(floating.points).mean > 5.0 * design.error.mean


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"of": "springs", "gravity": 9.81}, r"gravity: only latex hangs; expected none for springs"),
        ({"of": "latex", "gravity": -1.0}, r"gravity: must be from 0 to 1000 m/s\^2 \(got -1.0\)"),
        ({"of": "latex", "gravity": float("nan")}, r"gravity: must be from 0 to"),
        ({"of": "latex", "fixed": [0]}, r"fixed: needs a gravity to hang under"),
        ({"of": "latex", "gravity": 9.81}, r"ball: has no group neck to hang from; expected fixed, with .* groups"),
        ({"of": "latex", "gravity": 9.81, "fixed": []}, r"fixed: holds 0 of 56 vertices; expected some, and not all"),
        ({"of": "latex", "gravity": 9.81, "fixed": [99]}, r"fixed: ball has particles 0 to 55 \(got 99\)"),
        ({"of": "latex", "gravity": 9.81, "fixed": ["hook"]}, r"fixed: ball has no group hook; it has none"),
    ],
)
def test_what_cannot_hang_is_refused(asked: dict, sentence: str, tmp_path: Path):
    with pytest.raises(InputError, match=sentence):
        bw.design(replace(quad_sphere(3), name="ball"), folder=tmp_path / "out", **asked)
    assert not (tmp_path / "out").exists()


def test_command_says_what_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked = []
    monkeypatch.setattr(design, "design", lambda *args, **given: asked.append(given) or 1 / 0)
    write_obj(tmp_path / "egg.obj", egg())
    said = ["design", str(tmp_path / "egg.obj"), "-o", str(tmp_path / "out"), "--of", "latex", "--gravity", "9.81"]
    CliRunner().invoke(app, [*said, "--fixed", "3,neck,7"])
    CliRunner().invoke(app, said)
    assert [(each["gravity"], each["fixed"]) for each in asked] == [(9.81, [3, "neck", 7]), (9.81, Wanted.fixed)]
