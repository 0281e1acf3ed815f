"""Creases of a folded parcel: its stage and its picture keep the seam sharp, but none of the folds that it undoes."""

from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from balloon_warp import animate, load_scene
from balloon_warp.mesh.load import load_mesh
from balloon_warp.mesh.orientation import CREASE, SOFT_CREASE, sharp_edges
from balloon_warp.studio.render.stage_reader import RenderStage
from balloon_warp.studio.render.surface import SmoothSurface


def test_only_the_seam_of_the_airbag_is_sharp(tmp_path: Path):
    scene = load_scene("airbag", {"frames": 1})
    animate(scene, path := tmp_path / "airbag.usdc", device="cpu")
    folded, flat = (load_mesh(file) for file in (scene.balloon[0].mesh, scene.balloon[0].material.rest_mesh))
    stage = Usd.Stage.Open(str(path))
    prim = next(prim for prim in stage.Traverse() if UsdGeom.Mesh(prim))
    np.testing.assert_allclose(prim.GetAttribute("physics:restShapePoints").Get(), flat.points, atol=1e-6)
    edges = np.array(UsdGeom.Mesh(prim).GetCreaseIndicesAttr().Get()).reshape(-1, 2)
    assert 0 < len(edges) < len(sharp_edges(folded, SOFT_CREASE))
    # The flat bag is a square of two sheets: its seam is its outline.
    low, high = flat.points.min(axis=0), flat.points.max(axis=0)
    ends = flat.points[edges.ravel()]
    at_outline = (np.isclose(ends, low) | np.isclose(ends, high))[:, np.ptp(flat.points, axis=0) > 0.01].any(axis=1)
    assert at_outline.all()
    reader = RenderStage(path)
    reader.read_prims(0)
    drawn, cut = reader.meshes[0].surface.vertex_count, SmoothSurface(folded, CREASE).vertex_count
    assert drawn == SmoothSurface(flat, CREASE).vertex_count < cut
