"""The stage as a whole: its metadata, and a prim for each thing in the scene."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pxr import Sdf, Tf, Usd, UsdGeom

from balloon_warp.errors import InputError
from balloon_warp.files import check_writable, whole_file
from balloon_warp.frame import Frame
from balloon_warp.model import Model
from balloon_warp.outputs.usd.backdrop import glow_like_floor
from balloon_warp.outputs.usd.balloon import BalloonPrim
from balloon_warp.outputs.usd.body import BodyPrim, body_names
from balloon_warp.outputs.usd.deformable import define_gravity
from balloon_warp.outputs.usd.looks import check_textures, write_textures
from balloon_warp.outputs.usd.metadata import describe_stage
from balloon_warp.outputs.usd.names import prim_names, show_names
from balloon_warp.outputs.usd.net_forces import NetForcesPrim
from balloon_warp.outputs.usd.obstacle import ObstaclePrim, obstacle_names
from balloon_warp.outputs.usd.planes import PlanePrim, planes_of
from balloon_warp.outputs.usd.sphere import SpherePrim
from balloon_warp.outputs.usd.string import StringPrim
from balloon_warp.outputs.usd.studio import define_studio
from balloon_warp.outputs.usd.tube import TubePrim
from balloon_warp.warp_lock import lock_of

STAGE_SUFFIXES = (".usdc", ".usda", ".usd")
Prim = BalloonPrim | PlanePrim | SpherePrim | ObstaclePrim | BodyPrim | StringPrim | TubePrim | NetForcesPrim
SAVE_BYTES = 64 * 2**20
"""Size of time samples that are kept in memory before they are added to the file [bytes]; the time of that depends on
the frames alone, and so do the bytes"""


class StageWriter:
    """Writes frames of one world into a USD stage, which appears at `path` when the `with` block ends well.

    A binary file grows as frames come: saving it again adds to it, and frees the samples' memory. Text is kept until
    the end, as it would be written anew each time.

    A frame's velocities are differences of points, and so come with the frame that follows; the last one's at the end.

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
        self.path, self.model = Path(path), model
        self.lights, self.ground = lights, ground
        self._provenance = provenance
        check_writable(self.path, STAGE_SUFFIXES)
        check_textures(self.path, [model])
        self._file = ExitStack()
        self._grows = self.path.suffix.lower() != ".usda"
        self._unsaved_bytes = 0
        self._is_whole = True
        """Whether it is complete"""
        self._last: int | None = None
        """Frame that waits for its velocities"""

    def __enter__(self) -> Self:
        self.stage = Usd.Stage.CreateNew(str(self._file.enter_context(whole_file(self.path))))
        self._file.push(self._save)
        describe_stage(self.stage, self.model.scene, self._provenance, view=True)
        with lock_of(self.model.device):
            self._prims = self._define_prims()
        return self

    def write(self, frame: Frame) -> None:
        """Write one frame's time samples."""
        for prim in self._prims:
            prim.write(frame)
        self._end_frame(frame.number)

    def copy_frames(self, part: Path) -> int:
        """Copy the frames of a part that another writer of the same model wrote, and return the last number.

        Raises:
            InputError: it cannot be read.
        """
        try:
            source = Sdf.Layer.OpenAsAnonymous(str(part))
        except Tf.ErrorException:
            raise InputError(f"{part}: USD cannot open it; expected frames of a run that was stopped") from None
        numbers = range(int(source.startTimeCode), int(source.endTimeCode) + 1)
        paths = _animated_paths(source)
        for number in numbers:
            self._copy_frame(source, paths, number)
            self._end_frame(number)
        return numbers[-1]

    def write_part(self, path: Path, numbers: range) -> None:
        """Write frames that were written here into a stage of their own, which appears at `path`.

        Raises:
            InputError: it cannot be written.
        """
        source = self.stage.GetRootLayer()
        paths = _animated_paths(source)
        with self.another(path) as part:
            for number in numbers:
                part._copy_frame(source, paths, number)
                part._write_velocities(number, source)  # which has the frames beside the part, too
                part._count_frame(number)
            part.stage.SetStartTimeCode(numbers.start)

    def another(self, path: Path) -> "StageWriter":
        """Make a writer of the same prims into another stage."""
        part = StageWriter(path, self.model, lights=self.lights, ground=self.ground)
        part._is_whole = False
        return part

    def _copy_frame(self, source: Sdf.Layer, paths: Sequence[Sdf.Path], number: int) -> None:
        """Copy a frame as it is in a layer, but for the velocities."""
        for path in paths:
            value = source.QueryTimeSample(path, number)
            if value is not None and path.name != UsdGeom.Tokens.velocities:
                self.stage.GetAttributeAtPath(path).Set(value, number)

    def _write_velocities(self, number: int, source: Sdf.Layer) -> None:
        for balloon in self._balloons:
            balloon.write_velocities(number, source)

    def _write_last_velocities(self) -> None:
        if self._last is not None:
            self._write_velocities(self._last, self.stage.GetRootLayer())

    def _end_frame(self, number: int) -> None:
        """End a frame whose points are there, so that the velocities of the one before follow."""
        self._write_last_velocities()
        self._last = number
        self._count_frame(number)

    def _count_frame(self, number: int) -> None:
        """Count what may now be saved: when it is depends on the frames alone, so that the bytes do."""
        self.stage.SetEndTimeCode(number)
        self._unsaved_bytes += 2 * 12 * self.model.particle_count
        if self._grows and self._unsaved_bytes > SAVE_BYTES:
            self.stage.GetRootLayer().Save()
            self._unsaved_bytes = 0

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.__exit__(kind, error, traceback)

    def _save(self, kind: type[BaseException] | None, *_: object) -> None:
        """Save what the file's end begins with, so that a failure to save is one of its own."""
        if kind is None:
            self._write_last_velocities()
            if self.lights and self._last is not None:
                first = int(self.stage.GetStartTimeCode())
                frames = range(first, self._last + 1)
                define_studio(self.stage, self.model.scene, self._subjects, frames, backdrop=self.ground)
            if self._is_whole:
                write_textures(self.path, [self.model])
            self.stage.GetRootLayer().Save()

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
                glow_like_floor(plane.prim.GetPrim())
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


def _animated_paths(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the attributes with time samples."""
    paths: list[Sdf.Path] = []

    def look(path: Sdf.Path | str) -> None:
        path = Sdf.Path(path)
        if path.IsPropertyPath() and layer.GetNumTimeSamplesForPath(path):
            paths.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    return paths
