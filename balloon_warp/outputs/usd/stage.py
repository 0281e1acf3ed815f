"""The stage as a whole: its metadata, and a prim for each thing in the scene."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdGeom

from balloon_warp.files import check_writable
from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.outputs.usd.backdrop import glow_like_floor
from balloon_warp.outputs.usd.balloon import BalloonPrim
from balloon_warp.outputs.usd.body import BodyPrim, body_names
from balloon_warp.outputs.usd.deformable import define_gravity
from balloon_warp.outputs.usd.growing import GrowingStage, MovingGroup
from balloon_warp.outputs.usd.metadata import describe_stage
from balloon_warp.outputs.usd.names import prim_names, show_names
from balloon_warp.outputs.usd.net_forces import NetForcesPrim
from balloon_warp.outputs.usd.obstacle import ObstaclePrim, obstacle_names
from balloon_warp.outputs.usd.planes import PlanePrim, planes_of
from balloon_warp.outputs.usd.sphere import SpherePrim
from balloon_warp.outputs.usd.string import StringPrim
from balloon_warp.outputs.usd.studio import define_studio
from balloon_warp.outputs.usd.tube import TubePrim
from balloon_warp.scene.colors import paper_of
from balloon_warp.warp_lock import lock_of

STAGE_SUFFIXES = (".usdc", ".usda", ".usd")
Prim = BalloonPrim | PlanePrim | SpherePrim | ObstaclePrim | BodyPrim | StringPrim | TubePrim | NetForcesPrim


class StageWriter(GrowingStage):
    """Writes frames of one world into a USD stage, which appears at `path` when the `with` block ends well.

    Args:
        path: Stage to write, .usdc, .usda or .usd.
        model: Model that is simulated.
        provenance: Provenance of the stage, see `describe_stage`.
        lights: Whether it has lights, a backdrop and a camera.
        ground: Whether it has the ground, if the scene does, and the backdrop.

    Raises:
        InputError: the file cannot be written there.
    """

    def __init__(
        self,
        path: str | Path,
        model: Model,
        provenance: Mapping[str, Any] | None = None,
        *,
        lights: bool = True,
        ground: bool = True,
    ):
        check_writable(Path(path), STAGE_SUFFIXES)
        super().__init__(Path(path), [model])
        self.model, self.lights, self.ground = model, lights, ground
        self._provenance = provenance

    def write(self, frame: Frame) -> None:
        """Write one frame's time samples."""
        for prim in self._prims:
            prim.write(frame)
        self._write_velocities_before(0, frame.number)
        self._end_frame(0, frame.number)

    def _define(self) -> list[MovingGroup]:
        self.stage = Usd.Stage.Open(self.layer)
        describe_stage(self.stage, self.model.scene, self._provenance, view=True)
        with lock_of(self.model.device):
            self._prims = self._define_prims()
        points = [balloon.points for balloon in self._balloons]
        return [MovingGroup([Sdf.Path("/World")], points, 2 * 12 * self.model.particle_count)]

    def _another(self, path: Path) -> "StageWriter":
        return StageWriter(path, self.model, lights=self.lights, ground=self.ground)

    def _finish(self, last: int) -> None:
        if self.lights:
            frames = range(int(self.layer.startTimeCode), last + 1)
            define_studio(self.stage, self.model.scene, self._subjects, frames, backdrop=self.ground)

    def _define_prims(self) -> list[Prim]:
        stage, model, scene = self.stage, self.model, self.model.scene
        paths = self._balloon_paths()
        define_gravity(stage, scene)
        self._balloons = [BalloonPrim(stage, path, model, number) for number, path in enumerate(paths)]
        # After the balloons: who reads a stage's first mesh wants a balloon.
        drawn = [plane for plane in planes_of(scene) if self.ground or plane.name != "Ground"]
        planes = [PlanePrim(stage, plane, model) for plane in drawn]
        for plane in planes:
            if self.lights and plane.plane.name == "Ground":
                glow_like_floor(plane.prim.GetPrim(), paper_of(scene))
        spheres = [
            SpherePrim(stage, Sdf.Path(f"/World/Spheres/Sphere_{n}"), model, n) for n in range(model.sphere_count)
        ]
        obstacles = [
            ObstaclePrim(stage, Sdf.Path(f"/World/Obstacles/{name}"), model, n)
            for n, name in enumerate(obstacle_names(scene))
        ]
        bodies = [
            BodyPrim(stage, Sdf.Path(f"/World/Bodies/{name}"), model, n) for n, name in enumerate(body_names(scene))
        ]
        strings = [
            StringPrim(stage, Sdf.Path(f"/World/Strings/String_{n}"), model, n) for n in range(model.string_count)
        ]
        tubes = [TubePrim(stage, Sdf.Path(f"/World/Tubes/Tube_{n}"), model, n) for n in range(len(scene.tube))]
        forces = []
        if scene.net_forces:
            forces = [
                NetForcesPrim(stage, Sdf.Path(f"/World/NetForces/{path.name}"), model, n)
                for n, path in enumerate(paths)
            ]
        grouped = [*spheres, *obstacles, *bodies, *strings, *tubes, *forces]
        self._subjects = [prim.prim.GetPath() for prim in (*self._balloons, *spheres, *bodies, *strings, *tubes)]
        for group in {prim.prim.GetPath().GetParentPath() for prim in grouped}:
            UsdGeom.Scope.Define(stage, group)
        for prims, named in ((self._balloons, model.shapes), (obstacles, scene.obstacle), (bodies, scene.body)):
            paths = [prim.prim.GetPath() for prim in prims]
            show_names(stage.GetRootLayer(), paths, [each.name for each in named])
        return [*self._balloons, *planes, *grouped]

    def _balloon_paths(self) -> list[Sdf.Path]:
        """Name a path for each balloon, after its name, all different."""
        names = prim_names([shape.name for shape in self.model.shapes])
        return [Sdf.Path(f"/World/{name}") for name in names]
