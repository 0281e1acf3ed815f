"""A string in the stage."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from balloon_warp.frame import Frame
from balloon_warp.mesh import PolygonMesh
from balloon_warp.model import Model
from balloon_warp.model.strings import ANCHORED, anchors_of
from balloon_warp.outputs.knot import has_knot
from balloon_warp.outputs.usd.knot import KnotPrim, knot_path
from balloon_warp.outputs.usd.lines import define_lines
from balloon_warp.outputs.usd.material import paint
from balloon_warp.outputs.usd.presence import show_while_there
from balloon_warp.outputs.usd.strand import Strand
from balloon_warp.outputs.usd.string_curve import POINT_COUNT, string_curve
from balloon_warp.scene.colors import STRING_COLOR


def define_string(stage: Usd.Stage, path: Sdf.Path, held: PolygonMesh) -> UsdGeom.BasisCurves:
    """Return a curve as thin as suits the mesh that it holds; no points yet."""
    curve = define_lines(stage, path, [POINT_COUNT], width=0.008 * float(np.ptp(held.points, axis=0).max()))
    paint(curve, STRING_COLOR, roughness=0.8)
    return curve


class StringPrim:
    """String of the scene, as a curve, the mesh around it, and the knot where it is tied."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.model, self.number = model, number
        self.string = model.scene.string[number]
        self.particle = int(model.string_particle.numpy()[number]) - model.particle_offsets[self.string.balloon]
        held = model.shapes[self.string.balloon].mesh
        self.prim = define_string(stage, path, held)
        places = {name: model.parameters[name].numpy() for name in ANCHORED}
        anchor = anchors_of(model.scene, model.bodies, places)[0, number]
        start = np.linspace(anchor, held.points[self.particle], POINT_COUNT)
        self._strand = Strand(stage, self.prim, start)
        self._knot = None
        if has_knot(self.string, model.scene.balloon[self.string.balloon]):
            self._knot = KnotPrim(stage, knot_path(path), model.scene, number, held, self.particle)

    def write(self, frame: Frame) -> None:
        points = frame.points[self.string.balloon]
        anchor, end = frame.string_anchors[self.number], points[self.particle]
        length = float(frame.string_lengths[self.number])
        curve = string_curve(anchor, end, length, self.model.scene.up, frame.ground_height)
        self._strand.write(curve, frame.number)
        seen: list[UsdGeom.Gprim] = [self.prim, self._strand.mesh]
        if self._knot:
            self._knot.write(points, curve, frame.number)
            seen.append(self._knot.prim)
        for prim in seen:
            show_while_there(prim, self.model.scene, self.string, frame.number)
