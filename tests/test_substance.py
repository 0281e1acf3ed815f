"""Materials of balloons in a stage, for programs that go on simulating them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import fans, grid, quad_sphere
from motion import animated, assert_valid
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

from balloon_warp import Balloon, Inflation, Material, Scene, Simulator, Stiffness
from balloon_warp.model.build import build_model
from balloon_warp.model.shape import BalloonShape
from balloon_warp.model.skin import SheetStiffness, sheet_of_springs

RUBBERS = {
    "latex": 3.3e5,
    "foil": 1.5e9,
    "nylon": 8.0e8,
    "natural_rubber_treloar": 0.5 * (6.3e5 * 1.3 + 1.2e3 * 5.0 + 1.0e4 * 2.0),
}
"""presets, and the shear moduli at rest that are published of them [Pa]"""


def made_of(material: Material, **fields) -> Scene:
    """Return a ball of 20 cm in a file of centimeters, which flies and turns, in a scene with Z up."""
    ball = {"mesh": quad_sphere(2, 10.0), "unit": "cm", "name": "ball", "velocity": (1, 2, 3)}
    balloon = Balloon(**ball | {"angular_velocity": (0, 1, 4), "material": material, "friction": 0.7} | fields)
    return Scene(balloon=[balloon], up_axis="Z", frames=1, frames_per_second=1000)


def physics_of(stage: Usd.Stage) -> Usd.Prim:
    """Return the material that is bound to the ball for the purpose of physics."""
    prim = stage.GetPrimAtPath("/World/ball")
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    assert material.GetPath() != UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0].GetPath()
    return material.GetPrim()


@pytest.mark.full
@pytest.mark.parametrize("preset", RUBBERS)
def test_rubber_and_film_are_as_stiff_and_thick_as_the_scene_says(tmp_path: Path, preset: str):
    material = Material(preset=preset)
    stage = animated(made_of(material, inflation=Inflation(kind="pressure", pressure=1.0)), tmp_path / "stage.usda")
    substance, prim = physics_of(stage), stage.GetPrimAtPath("/World/ball")
    assert "PhysicsSurfaceDeformableMaterialAPI" in substance.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert substance.GetAttribute("physics:youngsModulus").Get() == pytest.approx(3.0 * RUBBERS[preset], rel=1e-6)
    assert substance.GetAttribute("physics:poissonsRatio").Get() == 0.5
    assert UsdPhysics.MaterialAPI(substance).GetDensityAttr().Get() == material.value("density")
    assert UsdPhysics.MaterialAPI(substance).GetDynamicFrictionAttr().Get() == pytest.approx(0.7)
    np.testing.assert_allclose(prim.GetAttribute("physics:thicknesses").Get(), [material.value("thickness")])
    assert prim.GetAttribute("physics:thicknesses:elementType").Get() == "constant"
    assert not prim.HasAttribute("physics:mass"), "it follows, and what is said twice may differ"
    assert_valid(stage)


@pytest.mark.full
@pytest.mark.parametrize(
    "material", [Material(kind="gent", gent_limit=30.0), Material(kind="neo_hookean", shear_modulus=1e5)]
)
def test_a_law_of_ones_own_numbers_too(tmp_path: Path, material: Material):
    stage = animated(made_of(material, inflation=Inflation(kind="pressure", pressure=1.0)), tmp_path / "stage.usda")
    modulus = physics_of(stage).GetAttribute("physics:youngsModulus").Get()
    assert modulus == pytest.approx(3.0 * (material.shear_modulus or 3.3e5), rel=1e-6)


def test_a_skin_that_is_not_as_thick_everywhere_says_so_of_each_point(tmp_path: Path):
    weights = np.linspace(1.0, 3.0, quad_sphere(2).vertex_count).tolist()
    material = Material(preset="latex", weights=weights)
    stage = animated(made_of(material, inflation=Inflation(kind="pressure", pressure=1.0)), tmp_path / "stage.usda")
    prim = stage.GetPrimAtPath("/World/ball")
    np.testing.assert_allclose(prim.GetAttribute("physics:thicknesses").Get(), 2e-4 * np.array(weights), rtol=1e-6)
    assert prim.GetAttribute("physics:thicknesses:elementType").Get() == "point"


@pytest.mark.parametrize("fixed", [[], [3]])
def test_velocities_stand_where_points_do(tmp_path: Path, fixed: list[int]):
    """Velocities at the default time are those at the start, in the stage's meters and axes."""
    scene = made_of(Material(), fixed=fixed)
    stage = animated(scene, tmp_path / "stage.usda")
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball"))
    frame = Simulator(scene, "cpu").read_frame()
    np.testing.assert_allclose(mesh.GetPointsAttr().Get(), frame.points[0], atol=1e-7)
    np.testing.assert_allclose(mesh.GetVelocitiesAttr().Get(), frame.velocities[0], atol=1e-6)
    assert len(mesh.GetVelocitiesAttr().GetTimeSamples()) == 2


def test_springs_say_their_sheet_and_their_masses(tmp_path: Path):
    stage = animated(made_of(Material(), mass=0.2), tmp_path / "stage.usda")
    substance, prim = physics_of(stage), stage.GetPrimAtPath("/World/ball")
    sheet = (substance.GetAttribute(f"physics:surface{each}Stiffness") for each in ("Stretch", "Shear", "Bend"))
    stretch, shear, bend = (each.Get() for each in sheet)
    assert stretch == pytest.approx(3.0 * shear)
    assert shear > 0.0
    assert bend == 0.0
    assert not UsdPhysics.MaterialAPI(substance).GetDensityAttr().HasAuthoredValue()
    for absent in ("youngsModulus", "poissonsRatio"):
        assert not substance.HasAttribute(f"physics:{absent}")
    assert not prim.HasAttribute("physics:thicknesses"), "springs have none"
    assert prim.GetAttribute("physics:masses:elementType").Get() == "point"
    assert sum(prim.GetAttribute("physics:masses").Get()) == pytest.approx(0.2, rel=1e-5)
    assert prim.GetAttribute("physics:mass").Get() == pytest.approx(0.2)


def test_what_is_fixed_has_no_mass_and_so_none_is_said_of_points(tmp_path: Path):
    stage = animated(made_of(Material(), fixed=[0]), tmp_path / "stage.usda")
    prim = stage.GetPrimAtPath("/World/ball")
    assert not prim.HasAttribute("physics:masses")
    assert prim.GetAttribute("physics:mass").Get() == pytest.approx(0.1)


@pytest.mark.parametrize("triangles", [False, True])
def test_the_sheet_swells_as_its_springs(triangles: bool):
    """The sheet has the energy of its springs in equibiaxial strain, whatever the mesh."""
    mesh = fans(grid(9, 7)) if triangles else grid(9, 7)
    shape, sheet, _ = _sheet(mesh, Stiffness(structural=13.0, shear=5.0, flexion=3.0))
    constants = np.array([13.0, 5.0, 3.0])[shape.springs.kind]
    strain = 1e-3
    of_springs = 0.5 * (constants * (strain * shape.springs.rest_lengths) ** 2).sum()
    assert (sheet.stretch + sheet.shear) * strain**2 * shape.area == pytest.approx(of_springs, rel=1e-6)


def test_the_sheet_bends_as_its_hinges():
    """The sheet has the bending energy of its hinges, curved both ways as a part of a large sphere."""
    shape, sheet, torsion = _sheet(grid(12, 12), Stiffness(torsion=0.4))
    points, radius = shape.mesh.points, 1000.0
    flat = np.ptp(points, axis=0).argmin()
    bowl = points.copy()
    bowl[:, flat] += (np.delete(points, flat, axis=1) ** 2).sum(axis=1) / (2.0 * radius)
    of_hinges = 0.5 * torsion * (shape.hinges.angles(bowl) ** 2).sum()
    of_sheet = sheet.bend * (1.0 + 1.0 / 3.0) / radius**2 * shape.area
    assert of_sheet == pytest.approx(of_hinges, rel=1e-3)


def _sheet(mesh: Any, stiffness: Stiffness) -> tuple[BalloonShape, SheetStiffness, float]:
    """Return a shape, its sheet, and its torsion."""
    model = build_model(Scene(balloon=[Balloon(mesh=mesh, stiffness=stiffness)]), "cpu")
    parameters = {name: values.numpy() for name, values in model.parameters.items()}
    sheet = sheet_of_springs(model.shapes[0], parameters, 0)
    assert sheet is not None
    return model.shapes[0], sheet, stiffness.torsion
