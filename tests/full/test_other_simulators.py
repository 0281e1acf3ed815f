"""Stages for other simulators, and for renderers that know OpenPBR."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from exported import BALL, scene
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation

from balloon_warp import animate
from balloon_warp.mesh.topology import triangulate

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stage") / "out.usdc"
    animate(scene(frames=2), path, device="cpu")
    return path


def test_a_balloon_is_a_surface_deformable(written: Path):
    stage = Usd.Stage.Open(str(written))
    prim = stage.GetPrimAtPath("/World/ball")
    applied = prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert {"PhysicsDeformableBodyAPI", "PhysicsSurfaceDeformableSimAPI", "PhysicsCollisionAPI"} <= set(applied)
    start = UsdGeom.Mesh(prim).GetPointsAttr().Get(0)
    np.testing.assert_allclose(prim.GetAttribute("physics:restShapePoints").Get(), start, atol=1e-6)
    np.testing.assert_allclose(UsdGeom.Mesh(prim).GetPointsAttr().Get(), start, atol=1e-6)
    np.testing.assert_array_equal(prim.GetAttribute("physics:restTriVertexIndices").Get(), triangulate(BALL)[0])
    assert prim.GetAttribute("physics:mass").Get() == pytest.approx(scene().balloon[0].mass)
    gravity = UsdPhysics.Scene(stage.GetPrimAtPath("/World/Physics"))
    assert tuple(gravity.GetGravityDirectionAttr().Get()) == (0.0, -1.0, 0.0)
    assert gravity.GetGravityMagnitudeAttr().Get() == pytest.approx(abs(scene().gravity))


def test_the_extra_brings_what_is_imported_here():
    """The extra installs the packages that these tests import, which would otherwise be skipped everywhere."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (others,) = (each for each in extras["test"] if each.startswith("balloon-warp["))
    brought = extras["test"] + [each for name in extras if name in others for each in extras[name]]
    assert {"newton", "newton-usd-schemas", "MaterialX"} <= {each.partition(">=")[0] for each in brought}


def test_every_mesh_has_points_without_a_time_too(written: Path):
    """Every mesh has points at the default time: Newton refuses a stage with one that has none."""
    stage = Usd.Stage.Open(str(written))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert any(mesh.GetPath().name.startswith("String") for mesh in meshes)
    for mesh in meshes:
        assert len(mesh.GetPointsAttr().Get()), mesh.GetPath()


def test_latex_is_a_variant_that_validators_need_not_know(written: Path):
    stage = Usd.Stage.Open(str(written))
    material = UsdShade.Material(stage.GetPrimAtPath("/World/Looks/ball"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert not UsdValidation.ValidationContext(validators).Validate(stage)
    assert material.ComputeSurfaceSource("mtlx")[0].GetIdAttr().Get() == "UsdPreviewSurface"
    material.GetPrim().GetVariantSet("surface").SetVariantSelection("openpbr")
    latex = material.ComputeSurfaceSource("mtlx")[0]
    assert latex.GetIdAttr().Get() == "ND_open_pbr_surface_surfaceshader"
    assert latex.GetInput("geometry_thin_walled").Get() is True
    assert latex.GetInput("base_color").Get() == material.ComputeSurfaceSource()[0].GetInput("diffuseColor").Get()
    assert material.ComputeSurfaceSource()[0].GetIdAttr().Get() == "UsdPreviewSurface"


def test_openpbr_has_the_inputs_that_latex_sets(written: Path):
    materialx = pytest.importorskip("MaterialX")
    library = materialx.createDocument()
    folders = materialx.getDefaultDataLibraryFolders()
    materialx.loadLibraries(folders, materialx.getDefaultDataSearchPath(), library)
    kinds = {"color3f": "color3", "float": "float", "bool": "boolean"}
    definition = library.getNodeDef("ND_open_pbr_surface_surfaceshader")
    known = {each.getName(): each.getType() for each in definition.getInputs()}
    stage = Usd.Stage.Open(str(written))
    material = UsdShade.Material(stage.GetPrimAtPath("/World/Looks/ball"))
    material.GetPrim().GetVariantSet("surface").SetVariantSelection("openpbr")
    for each in material.ComputeSurfaceSource("mtlx")[0].GetInputs():
        assert known[each.GetBaseName()] == kinds[str(each.GetTypeName())]
