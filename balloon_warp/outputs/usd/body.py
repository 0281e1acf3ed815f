"""A free rigid body in the stage: a gprim of its shape about its center of mass, with an animated place and turn."""

from collections.abc import Collection

import numpy as np
from pxr import Gf, Sdf, Usd, UsdPhysics

from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.outputs.usd.material import BODY_COLORS
from balloon_warp.outputs.usd.metadata import prim_names
from balloon_warp.outputs.usd.obstacle import Look, as_gf, define_obstacle
from balloon_warp.scene import Scene


def body_names(scene: Scene, taken: Collection[str] = ()) -> list[str]:
    """A prim name for each body: its own, or its shape's."""
    return prim_names((body.name or body.shape for body in scene.body), taken)


class BodyPrim:
    """One body of the scene, with what it weighs and how it turns as `UsdPhysics` has them."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        body, shape = model.scene.body[number], model.bodies[number]
        look = Look(model.scene.up_axis, np.zeros(3), 1.0)
        color = body.color or BODY_COLORS[number % len(BODY_COLORS)]
        self.prim = define_obstacle(
            stage, path, body.model_copy(update={"color": color}), shape.solid, np.zeros(7), look
        )
        self._place, self._turn = self.prim.GetOrderedXformOps()[:2]
        mass = float(model.parameters["body_mass"].numpy()[0, number])
        moments, axes = np.linalg.eigh(shape.inertia)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        from scipy.spatial.transform import Rotation  # takes long to load

        x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
        weighed = UsdPhysics.MassAPI.Apply(self.prim.GetPrim())
        weighed.CreateMassAttr(mass)
        weighed.CreateCenterOfMassAttr(Gf.Vec3f(0.0))
        weighed.CreateDiagonalInertiaAttr(Gf.Vec3f(*(mass * moments).tolist()))
        weighed.CreatePrincipalAxesAttr(Gf.Quatf(w, x, y, z))

    def write(self, frame: Frame) -> None:
        """Author where it is."""
        for op, value in zip((self._place, self._turn), as_gf(frame.body_poses[self.number]), strict=True):
            op.Set(value, Usd.TimeCode(frame.number))
