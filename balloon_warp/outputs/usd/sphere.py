"""A sphere in the stage, with an animated translate."""

from pxr import Gf, Sdf, Usd, UsdGeom

from balloon_warp.model import Model
from balloon_warp.outputs.usd.material import SPHERE_COLORS, paint
from balloon_warp.simulator import Frame


class SpherePrim:
    """One sphere of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        sphere = model.scene.sphere[number]
        self.prim = UsdGeom.Sphere.Define(stage, path)
        self.prim.CreateRadiusAttr(sphere.radius)
        self.prim.CreateExtentAttr([Gf.Vec3f(-sphere.radius), Gf.Vec3f(sphere.radius)])
        self._translate = self.prim.AddTranslateOp()
        paint(self.prim, sphere.color or SPHERE_COLORS[number % len(SPHERE_COLORS)], roughness=0.3)

    def write(self, frame: Frame) -> None:
        self._translate.Set(Gf.Vec3d(*frame.sphere_positions[self.number].tolist()), frame.number)
