"""A sphere in the stage, with an animated translate, and a body for other simulators."""

from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.outputs.usd.material import paint
from balloon_warp.outputs.usd.presence import show_while_there
from balloon_warp.outputs.usd.rigid import SURFACE, be_hit, move_freely
from balloon_warp.scene import Sphere
from balloon_warp.scene.colors import SPHERE_COLORS


def define_sphere(stage: Usd.Stage, path: Sdf.Path, sphere: Sphere, number: int) -> UsdGeom.XformOp:
    """Return a sphere and its material; returns the translate that moves it."""
    prim = UsdGeom.Sphere.Define(stage, path)
    prim.CreateRadiusAttr(sphere.radius)
    prim.CreateExtentAttr([Gf.Vec3f(-sphere.radius), Gf.Vec3f(sphere.radius)])
    translate = prim.AddTranslateOp()
    paint(prim, sphere.color or SPHERE_COLORS[number % len(SPHERE_COLORS)], roughness=0.3)
    return translate


class SpherePrim:
    """Sphere of the scene."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number, self._scene = number, model.scene
        self._translate = define_sphere(stage, path, model.scene.sphere[number], number)
        self.prim = UsdGeom.Sphere(stage.GetPrimAtPath(path))
        if model.scene.sphere[number].start == 0.0:  # UsdPhysics has no word for a body that is not there yet
            self._start(model)

    def _start(self, model: Model) -> None:
        """Write the sphere's start position, mass and velocities, before there are any frames."""
        names = ("mass", *SURFACE)
        mass, friction, restitution = (
            float(model.parameters[f"sphere_{name}"].numpy()[0, self.number]) for name in names
        )
        place, velocity, spin = (
            model.parameters[f"initial_sphere_{name}"].numpy()[0, self.number]
            for name in ("positions", "velocities", "spins")
        )
        self._translate.Set(Gf.Vec3d(*place.tolist()))
        UsdPhysics.MassAPI.Apply(self.prim.GetPrim()).CreateMassAttr(mass)
        be_hit(self.prim.GetPrim(), friction, restitution)
        move_freely(self.prim.GetPrim(), velocity, spin)

    def write(self, frame: Frame) -> None:
        self._translate.Set(Gf.Vec3d(*frame.sphere_positions[self.number].tolist()), frame.number)
        show_while_there(self.prim, self._scene, self._scene.sphere[self.number], frame.number)
