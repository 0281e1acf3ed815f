"""A free rigid body in the stage: a gprim of its shape about its center of mass, with an animated place and turn."""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.model.bodies import BodyShape, initial_centers, initial_turns
from balloon_warp.outputs.usd.names import prim_names
from balloon_warp.outputs.usd.obstacle import Look, as_gf, define_obstacle
from balloon_warp.outputs.usd.rigid import SURFACE, be_hit, move_freely
from balloon_warp.scene import Scene
from balloon_warp.scene.colors import BODY_COLORS


def body_names(scene: Scene, taken: Collection[str] = ()) -> list[str]:
    """Return a prim name for each body: its own, or its shape's."""
    return prim_names((body.name or body.shape for body in scene.body), taken)


def define_body(stage: Usd.Stage, path: Sdf.Path, scene: Scene, shape: BodyShape, number: int) -> UsdGeom.Gprim:
    """Define a body's gprim, with ops for position and rotation without values, and its `UsdPhysics` properties."""
    body, look = scene.body[number], Look(scene.up_axis, np.zeros(3), 1.0)
    otherwise = BODY_COLORS[number % len(BODY_COLORS)]
    prim = define_obstacle(stage, path, body, shape.solid, np.zeros(7), look, otherwise)
    _, axes = _principal(shape)
    from scipy.spatial.transform import Rotation  # takes long to load

    x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
    weighed = UsdPhysics.MassAPI.Apply(prim.GetPrim())
    weighed.CreateCenterOfMassAttr(Gf.Vec3f(0.0))
    weighed.CreatePrincipalAxesAttr(Gf.Quatf(w, x, y, z))
    return prim


def inertia_of(shape: BodyShape, mass: float) -> Gf.Vec3f:
    """Return the moments about its principal axes [kg m^2]."""
    return Gf.Vec3f(*(mass * _principal(shape)[0]).tolist())


def _principal(shape: BodyShape) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the moments of 1 kg [m^2], shape (3,), and axes, the columns of a rotation, shape (3, 3)."""
    moments, axes = np.linalg.eigh(shape.inertia)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return moments, axes


class BodyPrim:
    """Body of the scene, with its mass and velocities as `UsdPhysics` has them."""

    def __init__(self, stage: Usd.Stage, path: Sdf.Path, model: Model, number: int):
        self.number = number
        self.prim = define_body(stage, path, model.scene, model.bodies[number], number)
        self._place, self._turn = self.prim.GetOrderedXformOps()[:2]
        mass = float(model.parameters["body_mass"].numpy()[0, number])
        weighed = UsdPhysics.MassAPI(self.prim.GetPrim())
        weighed.CreateMassAttr(mass)
        weighed.CreateDiagonalInertiaAttr(inertia_of(model.bodies[number], mass))
        self._start(model)

    def _start(self, model: Model) -> None:
        """Write the body's start pose and velocities, before there are any frames."""
        from scipy.spatial.transform import Rotation  # takes long to load

        def own(name: str) -> NDArray[np.float32]:
            return model.parameters[name].numpy()[0, self.number]

        places = np.asarray(model.parameters["initial_body_positions"].numpy(), dtype=np.float64)
        center = initial_centers(model.scene, model.bodies, places)[0, self.number]
        turn = initial_turns(model.scene)[self.number]
        self._put(np.concatenate([center, turn]), Usd.TimeCode.Default())
        be_hit(self.prim.GetPrim(), *(float(own(f"body_{name}")) for name in SURFACE))
        back = Rotation.from_quat(turn).inv()
        velocity, spin = (back.apply(own(f"initial_body_{name}")) for name in ("velocities", "spins"))
        move_freely(self.prim.GetPrim(), velocity, spin)

    def write(self, frame: Frame) -> None:
        """Write the body's pose."""
        self._put(frame.body_poses[self.number], Usd.TimeCode(frame.number))

    def _put(self, pose: NDArray[np.floating], time: Usd.TimeCode) -> None:
        for op, value in zip((self._place, self._turn), as_gf(pose), strict=True):
            op.Set(value, time)
