"""Stage as a whole: its metadata, a prim for each thing in the scene, and its growth frame by frame."""

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pxr import Gf, Sdf, Tf, Usd, UsdGeom, Vt

from balloon_warp.errors import InputError
from balloon_warp.frame import Frame
from balloon_warp.model import Model, ModelPlan
from balloon_warp.scene import Scene
from balloon_warp.scene.around import paper_of
from balloon_warp.system.files import STAGE_KEY, check_writable, whole_file
from balloon_warp.system.warp_threads import lock_of
from balloon_warp.usd.balloon import BalloonPrim, NetForcesPrim, StringPrim, TubePrim, author_velocities, define_gravity
from balloon_warp.usd.material import check_textures, prim_names, show_names, write_textures
from balloon_warp.usd.solids import BodyPrim, ObstaclePrim, PlanePrim, SpherePrim, body_names, obstacle_names, planes_of
from balloon_warp.usd.studio import define_studio, glow_like_floor


def describe_stage(
    stage: Usd.Stage, scene: Scene, provenance: Mapping[str, Any] | None = None, view: bool = False
) -> None:
    """Write the default prim /World, up axis, units and time, and `customLayerData`.

    The latter has, as `balloonWarp`, by which the stage is known as ours, the frame of a picture, its camera if `view`
    is wanted, and the stage's provenance: words, numbers and tables of them, and the scene, as JSON.
    """
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    UsdGeom.SetStageUpAxis(stage, scene.up_axis)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(scene.frames_per_second)
    stage.SetFramesPerSecond(scene.frames_per_second)
    stage.SetStartTimeCode(0)
    layer = stage.GetRootLayer()
    layer.comment = scene.description
    said = dict(provenance or {})
    if "scene" in said:
        said["scene"] = json.dumps(said["scene"])
    if scene.picture_frame is not None:
        said["pictureFrame"] = min(scene.picture_frame, scene.frames)
    if scene.picture is not None and view:
        place = scene.picture.model_dump(exclude_none=True)
        said["pictureView"] = {name: Gf.Vec3d(*n) if isinstance(n, tuple) else n for name, n in place.items()}
    layer.customLayerData = {STAGE_KEY: said}


def write_playlist(path: Path, still: str, parts: Sequence[tuple[int, str]], last: int, scene: Scene) -> None:
    """Write a stage that plays parts one after the other, as value clips.

    Args:
        path: where to, beside the other files.
        still: the name of the stage that has all but the frames.
        parts: the first frame of each part, and its name.
        last: the last frame of the last one.
        scene: of the stage.
    """
    stage = _stage_over(path, [still], last, scene)
    clips = Usd.ClipsAPI(stage.GetDefaultPrim())
    clips.SetClipPrimPath(str(stage.GetDefaultPrim().GetPath()))
    clips.SetClipAssetPaths([Sdf.AssetPath(f"./{name}") for _, name in parts])
    clips.SetClipActive(Vt.Vec2dArray([(first, number) for number, (first, _) in enumerate(parts)]))
    clips.SetClipTimes(Vt.Vec2dArray([(0, 0), (last, last)]))
    stage.GetRootLayer().Save()


def write_overlay(path: Path, still: str, parts: Sequence[str], last: int, scene: Scene) -> None:
    """Write a stage of parts that have different prims move, as layers of it; see `write_playlist`."""
    stage = _stage_over(path, [*parts, still], last, scene)
    stage.GetRootLayer().Save()


def _stage_over(path: Path, layers: Sequence[str], last: int, scene: Scene) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    for name in layers:
        stage.GetRootLayer().subLayerPaths.append(f"./{name}")
    describe_stage(stage, scene)
    stage.SetEndTimeCode(last)
    return stage


SAVE_BYTES = 64 * 2**20
"""Size of time samples that are kept in memory before they are added to the file [bytes]; the time of that depends on
the frames alone, and so do the bytes"""


@dataclass(frozen=True)
class MovingGroup:
    """Prims that move together: of a run all, of a batch those of the worlds that are simulated together."""

    prims: Sequence[Sdf.Path]
    """Prims under which the attributes with time samples are"""
    points: Sequence[tuple[Sdf.Path, Sdf.Path]]
    """Attributes of points, and of their velocities"""
    frame_bytes: int
    """Approximate size of a frame [bytes]"""


class GrowingStage(ABC):
    """Stage that appears at its path when the `with` block ends well, and grows until then.

    A binary file is saved now and then: saving it again adds to it, and frees the samples' memory. Text is kept until
    the end, as it would be written anew each time.

    Prims move in groups, whose frames may come one after the other, or all frames of one group before the next. A
    frame's velocities are differences of points, and so come with the frame that follows; the last one's at the end.

    Args:
        path: Stage to write, .usdc, .usda or .usd.
        textured: Models or plans whose textures go beside the stage.

    Raises:
        InputError: a texture cannot be written there.
    """

    def __init__(self, path: Path, textured: Sequence[Model | ModelPlan]):
        self.path, self._textured = path, textured
        check_textures(path, textured)
        self._grows = path.suffix.lower() != ".usda"
        self._unsaved_bytes = 0
        self._is_whole = True
        """Whether it is complete, and not a part"""
        self._last: int | None = None
        """Last frame, whose velocities wait for the end"""

    @abstractmethod
    def _define(self) -> list[MovingGroup]:
        """Define all prims in `layer`, without any frame; return those that move."""

    @abstractmethod
    def _another(self, path: Path) -> "GrowingStage":
        """Make a writer of the same prims into another stage."""

    @abstractmethod
    def _finish(self, last: int) -> None:
        """Write the prims that depend on all frames, such as the studio, once these are there."""

    def __enter__(self) -> Self:
        with ExitStack() as files:
            self.layer = Sdf.Layer.CreateNew(str(files.enter_context(whole_file(self.path))))
            files.push(self._save)
            self._groups = self._define()
            self._file = files.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.__exit__(kind, error, traceback)

    def copy_part(self, path: Path, numbers: range, groups: Sequence[int]) -> None:
        """Write frames of some groups as they are in a part that a writer of the same prims wrote.

        Raises:
            InputError: it cannot be read.
        """
        try:
            source = Sdf.Layer.OpenAsAnonymous(str(path))
        except Tf.ErrorException:
            raise InputError(f"{path}: USD cannot open it; expected the frames of an interrupted run") from None
        self._copy(source, numbers, groups, self._write_velocities_before)
        self._last = numbers[-1]

    def write_part(self, path: Path, numbers: range, groups: Sequence[int]) -> None:
        """Write frames that are in this stage into one of their own, which appears at `path`.

        Raises:
            InputError: it cannot be written.
        """
        with self._part(path) as part:
            part._copy(
                self.layer, numbers, groups, lambda group, number: part._write_velocities(group, number, self.layer)
            )
            part.layer.startTimeCode = numbers.start

    def write_still(self, path: Path) -> None:
        """Write a stage of the same prims without any frame.

        Raises:
            InputError: it cannot be written.
        """
        with self._part(path):
            pass

    def _part(self, path: Path) -> "GrowingStage":
        part = self._another(path)
        part._is_whole = False
        return part

    def _copy(
        self, source: Sdf.Layer, numbers: range, groups: Sequence[int], write_velocities: Callable[[int, int], None]
    ) -> None:
        """Copy frames in the order in which they are written; `write_velocities` gets each group and frame."""
        group_of = {prim: number for number, group in enumerate(self._groups) for prim in group.prims}
        paths: list[list[Sdf.Path]] = [[] for _ in self._groups]
        for path in _animated_paths(source):
            if path.name != UsdGeom.Tokens.velocities:
                paths[next(group_of[prefix] for prefix in path.GetPrefixes() if prefix in group_of)].append(path)
                self._require(source.GetAttributeAtPath(path))
        for number in numbers:
            for group in groups:
                with Sdf.ChangeBlock():
                    for path in paths[group]:
                        if (value := source.QueryTimeSample(path, number)) is not None:
                            self.layer.SetTimeSample(path, number, value)
                    write_velocities(group, number)
                self._count(group, number)

    def _require(self, attribute: Sdf.AttributeSpec) -> None:
        """Make sure that the layer has an attribute: some come with their first frame."""
        path = attribute.path
        if not self.layer.GetAttributeAtPath(path):
            prim = self.layer.GetPrimAtPath(path.GetPrimPath())
            Sdf.AttributeSpec(prim, attribute.name, attribute.typeName, attribute.variability)

    def _write_velocities(self, group: int, number: int, source: Sdf.Layer) -> None:
        """Write the velocities of a frame, from the points in `source`, a layer of the same prims."""
        for points, velocities in self._groups[group].points:
            author_velocities(self.layer, velocities, source, points, number)

    def _write_velocities_before(self, group: int, number: int) -> None:
        """Write the velocities of the frame before one whose points are there."""
        self._write_velocities(group, number - 1, self.layer)

    def _end_frame(self, group: int, number: int) -> None:
        """End a frame of a group whose samples are written, but for its velocities."""
        self._last = number
        self._count(group, number)

    def _count(self, group: int, number: int) -> None:
        """Save the authored samples once they are large enough, which the frames alone decide, and so the bytes."""
        self.layer.endTimeCode = max(number, self.layer.endTimeCode)
        self._unsaved_bytes += self._groups[group].frame_bytes
        if self._grows and self._unsaved_bytes > SAVE_BYTES:
            self.layer.Save()
            self._unsaved_bytes = 0

    def _save(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the end of the stage and save it before the file closes, so that a failure to save is its own."""
        if kind is not None:
            return
        if self._last is not None:
            with Sdf.ChangeBlock():
                for group in range(len(self._groups)):
                    self._write_velocities(group, self._last, self.layer)
            self._finish(self._last)
        if self._is_whole:
            write_textures(self.path, self._textured)
        self.layer.Save()


def _animated_paths(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the attributes with time samples."""
    found: list[Sdf.Path] = []

    def look(path: Sdf.Path | str) -> None:
        path = Sdf.Path(path)
        if path.IsPropertyPath() and layer.GetNumTimeSamplesForPath(path):
            found.append(path)

    layer.Traverse(Sdf.Path.absoluteRootPath, look)
    return found


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
