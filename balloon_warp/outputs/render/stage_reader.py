"""A stage as something to make pictures of."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdUtils

from balloon_warp.errors import InputError
from balloon_warp.marks import STAGE_KEY
from balloon_warp.mesh.usd_open import listed, open_meshes
from balloon_warp.mesh.usd_shapes import others_than
from balloon_warp.mesh.usd_surfaces import missing_image
from balloon_warp.outputs.camera import Camera
from balloon_warp.outputs.moment import Moment
from balloon_warp.outputs.render.prims import CapsulePrim, Capsules, CurvesPrim, MeshPrim, SpherePrim
from balloon_warp.outputs.render.timing import timing_of
from balloon_warp.outputs.usd import STAGE_SUFFIXES
from balloon_warp.outputs.usd.camera import OURS
from balloon_warp.outputs.usd.presence import is_shown
from balloon_warp.suggestions import did_you_mean_file

LINEAR, INVISIBLE = UsdGeom.Tokens.linear, UsdGeom.Tokens.invisible
DRAWN = (UsdGeom.Mesh, UsdGeom.Sphere, UsdGeom.Capsule, UsdGeom.BasisCurves)
"""Kinds of prims that are drawn, where other shapes have become meshes"""


class Plane:
    """A level plane without an end, made of a level mesh."""

    def __init__(self, mesh: MeshPrim):
        self._mesh = mesh
        self.color = mesh.cover.colors[0]
        """Linear RGB, shape (3,)"""

    def height(self, moment: Moment) -> float:
        return float(self._mesh.points(moment)[0, 1])


class RenderStage:
    """The meshes and other shapes, linear curves, ground, water and camera of a stage.

    Invisible prims and those of purpose `guide` or `proxy` are left out. A level mesh called "Ground" is the ground,
    one called "Water" is water.

    Args:
        path: any file that USD opens.
        rounds: whether spheres and capsules are meshes, too.
        on_note: called with sentences on missing files and left-out shapes of the stage.

    Raises:
        InputError: the file is missing, cannot be read as a stage, or its time codes run nowhere or at no rate.
    """

    def __init__(self, path: Path, *, rounds: bool = False, on_note: Callable[[str], None] = lambda sentence: None):
        self.path = path
        if not path.is_file():
            hint = did_you_mean_file(path, STAGE_SUFFIXES)
            raise InputError(f"{path}: no such file; expected a USD stage{hint}")
        self._quiet = UsdUtils.CoalescingDiagnosticDelegate()  # while it lives, USD prints nothing
        self._stage, warnings = open_meshes(path, rounds=rounds)
        for sentence in (*warnings, *left_out(self._stage)):
            on_note(sentence)
        timing = timing_of(self._stage, path)
        self._stage, self.first_frame, self.last_frame, self.frames_per_second = timing

    @property
    def picture_frame(self) -> int:
        """The frame for a single picture: the one that the stage names, or the last where there is none so late."""
        named = self._said("pictureFrame")
        return min(named, self.last_frame) if isinstance(named, int) else self.last_frame

    @property
    def picture_view(self) -> dict[str, float | tuple[float, float, float]]:
        """Settings of camera and light that the stage has for pictures, by the names of a scene's fields."""
        said = self._said("pictureView")
        view: dict[str, float | tuple[float, float, float]] = {}
        for name, value in said.items() if isinstance(said, dict) else ():
            if name in ("look_at", "paper") and isinstance(value, Gf.Vec3d):
                x, y, z = np.array(value).tolist()
                view[name] = (x, y, z)
            elif name in ("azimuth", "elevation", "zoom", "light") and isinstance(value, float | int):
                view[name] = float(value)
        return view

    @property
    def picture_light(self) -> dict[str, Any]:
        """Color of the paper and azimuth of the main light, where the stage says them."""
        return {name: value for name, value in self.picture_view.items() if name in ("paper", "light")}

    def _said(self, name: str):
        """Return a value that a stage of ours has about itself."""
        ours = self._stage.GetRootLayer().customLayerData.get(STAGE_KEY)
        return ours.get(name) if isinstance(ours, dict) else None

    @property
    def stage(self) -> Usd.Stage:
        """Stage that USD has opened."""
        return self._stage

    def read_prims(self, frame: float) -> None:
        """Find the visible prims, as they are at a frame.

        Raises:
            InputError: there is nothing to draw.
        """
        moment = Moment(self._stage, frame)
        self.meshes: list[MeshPrim] = []
        self.rounds: list[SpherePrim | CapsulePrim | CurvesPrim] = []
        self.ground: Plane | None = None
        self.water: Plane | None = None
        self._camera: UsdGeom.Camera | None = None
        for prim in Usd.PrimRange(self._stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
            self._take(prim, moment)
        if not self.meshes and not self.rounds:
            raise InputError(f"{self.path}: has no visible mesh, solid shape or linear curves to draw at frame {frame}")

    def points(self, frame: float) -> list[NDArray[np.float64]]:
        """Return the points of each mesh, shape (point_count, 3) each."""
        moment = Moment(self._stage, frame)
        return [mesh.points(moment) for mesh in self.meshes]

    def gone(self, frame: float) -> NDArray[np.bool_] | None:
        """Return a mask of the triangles of all meshes that are absent; None where all are always present."""
        moment = Moment(self._stage, frame)
        each = [mesh.gone(moment) for mesh in self.meshes]
        if all(gone is None for gone in each):
            return None
        pairs = zip(self.meshes, each, strict=True)
        return np.concatenate([np.zeros(len(m.surface.triangles), bool) if g is None else g for m, g in pairs])

    def heights(self, frame: float) -> tuple[float, float]:
        """Return the heights of the ground and the water; minus infinity without one."""
        moment = Moment(self._stage, frame)
        ground, water = (plane.height(moment) if plane else -math.inf for plane in (self.ground, self.water))
        return ground, water

    def capsules(self, frame: float) -> Capsules:
        """Return the spheres, the capsules and all curves' segments."""
        moment = Moment(self._stage, frame)
        each = [
            Capsules(np.empty((0, 3)), np.empty((0, 3)), np.empty(0)),
            *(prim.capsules(moment) for prim in self.rounds),
        ]
        return Capsules(*(np.concatenate(arrays) for arrays in zip(*each, strict=True)))

    def camera(self, frame: float, aspect: float) -> Camera | None:
        """Return the stage's first perspective camera, its view widened to a picture of this aspect; None without one.

        Raises:
            InputError: the camera has no angle of view or no axes.
        """
        if self._camera is None:
            return None
        moment = Moment(self._stage, frame)
        camera = self._camera.GetCamera(moment.time)
        aperture = max(camera.verticalAperture, camera.horizontalAperture / aspect)
        source = f"{self.path}: the camera {self._camera.GetPath()} at frame {frame}"
        if not (0.0 < aperture < math.inf and 0.0 < camera.focalLength < math.inf):
            raise InputError(
                f"{source} has an aperture of {aperture:g} and a focal length of {camera.focalLength:g}; "
                "expected positive ones"
            )
        if not moment.is_frame(camera.transform):
            raise InputError(
                f"{source} has a transform that is singular or not finite; expected a finite position and three axes"
            )
        half_height = aperture / (2.0 * camera.focalLength)
        return Camera(moment.origin(camera.transform), moment.axes(camera.transform), half_height * aspect, half_height)

    def _take(self, prim: Usd.Prim, moment: Moment) -> None:
        if camera := UsdGeom.Camera(prim):
            ours = prim.HasCustomDataKey(OURS)  # stands where all frames can be seen: a picture finds a nearer place
            if self._camera is None and not ours and camera.GetCamera(moment.time).projection == Gf.Camera.Perspective:
                self._camera = camera
        elif _is_drawn(prim, moment.time):
            if UsdGeom.Mesh(prim):
                mesh = MeshPrim(prim, moment, Moment(self._stage, self.first_frame))
                if len(mesh.surface.triangles) == 0:
                    return
                points = mesh.points(moment)
                width, height, _ = np.ptp(points, axis=0)
                name = prim.GetName().lower()
                if name in ("ground", "water") and height <= 1e-6 * width:
                    setattr(self, name, Plane(mesh))
                else:
                    self.meshes.append(mesh)
            elif UsdGeom.Sphere(prim):
                self.rounds.append(SpherePrim(prim, moment))
            elif UsdGeom.Capsule(prim):
                self.rounds.append(CapsulePrim(prim, moment))
            elif UsdGeom.BasisCurves(prim).GetTypeAttr().Get() == LINEAR:
                curves = CurvesPrim(prim, moment)
                if curves.segment_count:
                    self.rounds.append(curves)


def left_out(stage: Usd.Stage) -> list[str]:
    """Return sentences on shapes that a stage shows but that cannot be taken, and on images that are missing."""
    every = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
    shown = [prim for prim in every if is_shown(prim) and UsdGeom.Imageable(prim).ComputeVisibility() != INVISIBLE]
    curves = [each for each in map(UsdGeom.BasisCurves, shown) if each and each.GetTypeAttr().Get() != LINEAR]
    others = [*others_than(shown, DRAWN), *(f"{each.GetPath()} (BasisCurves that are not linear)" for each in curves)]
    lost = [f"{prim.GetPath()} (@{image}@)" for prim in stage.Traverse() if (image := missing_image(prim))]
    return [
        *([f"Left out of the stage: {listed(others)}."] if others else []),
        *([f"Missing images: {listed(lost)}."] if lost else []),
    ]


def _is_drawn(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    if not any(kind(prim) for kind in DRAWN):
        return False
    imageable = UsdGeom.Imageable(prim)
    return is_shown(prim) and imageable.ComputeVisibility(time) != INVISIBLE
