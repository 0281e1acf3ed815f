"""Trajectories: all motion of a simulation in arrays, in one call, or of a batch in a file for each world."""

import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from balloon_warp.batch.recorder import SHA256, BatchVary, Group, Record, fields_of, is_mesh, plan_groups, units_of
from balloon_warp.batch.table import (
    AXES,
    FORMATS,
    SUFFIX,
    Arrays,
    Attribute,
    Field,
    FileContents,
    WorldFile,
    all_frames,
    chunk_shape,
    format_named,
    make_room,
    put_frames,
)
from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.frame import things_of
from balloon_warp.kernels.laws import Law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import edges_of, signed_volume, total_area, triangulate
from balloon_warp.model import ModelPlan, lay_out, worlds_of
from balloon_warp.model.parameters import scene_to_vary
from balloon_warp.model.state import require_memory
from balloon_warp.run.checkpoints import JOB_NAME, PartialFolder, as_json
from balloon_warp.run.report import describe_scene, installed_versions, without_folders
from balloon_warp.scene import Scene, SceneLike
from balloon_warp.scene.load import Override, override_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.api import Shown, check_fields, checked, described
from balloon_warp.system.files import manifest_text, require_ours_in, target_of, whole_file
from balloon_warp.system.warp_threads import lock_of, pick_device


@described
@dataclass(frozen=True, repr=False)
class Trajectories(Shown):
    """Motion of everything in a scene, as arrays of NumPy.

    With several worlds, all but `times` and `worlds` have world_count as their first dimension, before those named
    here.
    """

    scene: Scene
    meshes: list[PolygonMesh]
    """Meshes of the balloons at the start: names, faces"""
    times: NDArray[np.float64]
    """Times of the frames [s], shape (frame_count,): the start, and then each recorded one"""
    points: list[NDArray[np.float32]]
    """Positions of each balloon's particles [m], shape (frame_count, particle_count, 3)"""
    velocities: list[NDArray[np.float32]]
    """Velocities of each balloon's particles [m/s], shape (frame_count, particle_count, 3)"""
    pressures: NDArray[np.float32]
    """Gauge pressures of balloons with pressure or gas [Pa], 0 for others, shape (frame_count, balloon_count)"""
    gas_amounts: NDArray[np.float64]
    """Amount of gas in each balloon [mol], shape (frame_count, balloon_count)"""
    sphere_positions: NDArray[np.float32]
    """Positions of spheres [m], shape (frame_count, sphere_count, 3)"""
    sphere_velocities: NDArray[np.float32]
    """Velocities of spheres [m/s], shape (frame_count, sphere_count, 3)"""
    worlds: NDArray[np.int64]
    """Numbers of the worlds, shape (world_count,): not all, where a loss is asked on one of several workers"""

    @cached_property
    def volumes(self) -> NDArray[np.float64]:
        """Volume of each balloon [m^3], shape (frame_count, balloon_count): the enclosed one, where it is closed."""
        return self._measured(signed_volume)

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """Area of each balloon [m^2], shape (frame_count, balloon_count)."""
        return self._measured(total_area)

    def _measured(self, measure: Callable[[PolygonMesh], float]) -> NDArray[np.float64]:
        columns = []
        for mesh, points in zip(self.meshes, self.points, strict=True):
            shapes = points.reshape(-1, *points.shape[-2:]).astype(np.float64)
            column = [measure(replace(mesh, points=shape)) for shape in shapes]
            columns.append(np.array(column).reshape(points.shape[:-2]))
        return np.stack(columns, axis=-1)

    def __repr__(self) -> str:
        *worlds, frames = self.pressures.shape[:-1]
        names = ", ".join(f"{mesh.name} of {mesh.vertex_count} particles" for mesh in self.meshes)
        many = f"{worlds[0]} worlds, " if worlds else ""
        return f"Trajectories({names}; {many}{frames} frames, {self.times[0]:g} to {self.times[-1]:g} s)"


@checked
def simulate(
    scene: SceneLike,
    overrides: Mapping[str, Any] | Iterable[Override] = (),
    *,
    world_count: int | None = None,
    vary: BatchVary | None = None,
    every: int = 1,
    device: str | None = None,
    schedule: str = "auto",
    laws: Sequence[Law] = (),
    on_frame: Callable[[int], None] = lambda number: None,
) -> Trajectories:
    """Simulate a scene from start to end, and return the motion of everything.

    Args:
        scene: Scene, name of a bundled one, scene file, or mesh, as a file or in memory.
        overrides: Dotted paths and values, as in `load_scene`: {"frames": 60, "balloon.mass": 2.0}.
        world_count: Number of worlds, copies of the scene side by side; as many as `vary` has values, if not given.
        vary: Values that differ between worlds: dotted paths, and a value for each world.
        every: Interval of recorded frames: 2 records every second one.
        device: Warp device; the GPU, or else the CPU, if not given.
        schedule: Parallel schedule: "scatter", "gather", "block", "lanes", "octets", or "auto" for the fastest.
        laws: User-defined laws beside the built-in ones; see `balloon_warp.laws`.
        on_frame: Called with the number of each simulated frame.

    Raises:
        InputError: the scene cannot be simulated, a varied value is wrong or makes other meshes, or the trajectories do
            not fit into the memory.
        BlowUpError: a world blew up.
    """
    scene = scene_to_vary(scene, vary, overrides)
    if every < 1:
        raise InputError(f"every: must be at least 1 (got {every})")
    world_count = worlds_of(world_count, vary)
    groups = plan_groups(scene, world_count, vary or {}, laws)
    meshes = [shape.mesh for shape in groups[0].plan.shapes]
    tracks, target = empty_tracks(groups, world_count, scene.frames // every + 1), pick_device(device)
    for group in groups:
        with lock_of(target):
            simulator = Simulator.of_model(lay_out(group.plan, target), schedule)
        for number in range(scene.frames + 1):
            if number:
                simulator.step_unread()
            if number % every == 0:
                record(tracks, simulator, group, number // every)
            on_frame(number)
    times = np.arange(0, scene.frames + 1, every) / scene.frames_per_second
    return Trajectories(scene, meshes, times, **by_balloon(tracks, meshes), worlds=np.arange(world_count))


def empty_tracks(groups: Sequence[Group], world_count: int, frames: int) -> dict[str, NDArray]:
    """Return the room for all that is recorded, by the names of the state's arrays, shape (world_count, frames, ...).

    Raises:
        InputError: it does not fit, or the groups are of other meshes.
    """
    plan = groups[0].plan
    if any(group.plan.particle_count != plan.particle_count for group in groups):
        raise InputError("vary: meshes of different sizes need separate trajectories; expected one mesh, or run_batch")
    particles, spheres, balloons = plan.particle_count, len(plan.scene.sphere), len(plan.shapes)
    require_memory(pick_device("cpu"), [world_count], [frames * 24 * (particles + spheres + balloons)])

    def room(*shape: int, dtype: Any = np.float32) -> NDArray:
        return np.zeros((world_count, frames, *shape), dtype=dtype)

    return {
        "points": room(particles, 3),
        "velocities": room(particles, 3),
        "pressures": room(balloons),
        "gas_amounts": room(balloons, dtype=np.float64),
        "sphere_positions": room(spheres, 3),
        "sphere_velocities": room(spheres, 3),
    }


def record(tracks: Mapping[str, NDArray], simulator: Simulator, group: Group, place: int, first: int = 0) -> None:
    """Write down where a group's worlds are; the number of the world that tracks begin with is `first`.

    Raises:
        BlowUpError: a world blew up.
    """
    rows = group.worlds - first
    for name, track in tracks.items():
        if track.size:
            with lock_of(simulator.model.device):
                track[rows, place] = getattr(simulator.state, name).numpy()
            finite = np.isfinite(track[rows, place]).reshape(len(rows), -1).all(axis=1)
            if not finite.all():
                raise BlowUpError(simulator.diagnose(int(finite.argmin()), simulator.frame_number))


def by_balloon(tracks: dict[str, NDArray], meshes: Sequence[PolygonMesh]) -> dict[str, Any]:
    """Split the tracks as `Trajectories` has them: particles by balloon, and a single world without its dimension."""
    ends = np.cumsum([mesh.vertex_count for mesh in meshes])[:-1]
    alone = len(tracks["pressures"]) == 1
    found: dict[str, Any] = {name: track[0] if alone else track for name, track in tracks.items()}
    return found | {name: np.split(found[name], ends, axis=-2) for name in ("points", "velocities")}


MOST_ATTRIBUTES = 500
"""Number of values of a scene above which only those are attributes that vary; the manifest has all"""


class Contents:
    """Contents of the files of a batch.

    Args:
        scene: common to all worlds.
        vary: values that differ between them.
        laws: your own.
        every: step between frames that are written.
        columns: the same as `BatchTask.varied`.
        hashes: of the scene's files, by place.
    """

    def __init__(
        self,
        scene: Scene,
        vary: BatchVary,
        laws: Sequence[Law],
        every: int,
        columns: Mapping[str, list[Any]],
        hashes: Mapping[str, str],
    ):
        self.scene, self._every, self._hashes, self.columns = scene, every, hashes, columns
        self._targets = {path: _targets(scene, path, values) for path, values in vary.items()}
        self._units = units_of(scene, vary, laws)
        for path in filter(is_mesh, vary):
            self._targets[f"{path}{SHA256}"] = [f"{target}{SHA256}" for target in self._targets[path]]

    @property
    def frames(self) -> int:
        """Number of frames that are written."""
        return self.scene.frames // self._every + 1

    def of_group(self, group: Group) -> WorldFile:
        """Return the contents common to the files of a group: those of its first world."""
        plan = group.plan
        attributes: dict[str, Attribute] = {**self._common, "substeps": plan.substeps}
        attributes["balloons"] = ", ".join(shape.name for shape in plan.shapes)
        if plan.scene.contacts:
            attributes["things"] = ", ".join(things_of(plan))
        common = WorldFile(attributes, _static(plan), self._times, fields_of(plan, self.frames))
        return self.of_world(common, int(group.worlds[0]), 1)

    def of_world(self, common: WorldFile, world: int, health: int) -> WorldFile:
        """Return the contents of a world's file."""
        own: dict[str, Attribute] = {"world": world, "health": health}
        for path, values in self.columns.items():
            for name in (*self._targets[path], path):
                own[name] = values[world]
        return replace(common, attributes={**common.attributes, **own})

    @cached_property
    def described(self) -> dict[str, Any]:
        """The scene, and the hashes of its files, the same wherever they are."""
        return without_folders({"scene": describe_scene(self.scene), "files": self._hashes})

    @cached_property
    def _common(self) -> dict[str, Attribute]:
        rate = self.scene.frames_per_second
        hashes = {f"{place}{SHA256}": digest for place, digest in self._hashes.items()}
        numbers = _flat(self.described["scene"]) | hashes
        told = numbers if len(numbers) <= MOST_ATTRIBUTES else {}
        ours: dict[str, Attribute] = {"world": 0, "health": 1, "every": self._every, "time_step": self._every / rate}
        units = {**self._units, "time_step": "s"}
        units |= {target: units[path] for path, targets in self._targets.items() if path in units for target in targets}
        return {**told, **ours, "units": json.dumps(units)}

    @property
    def _times(self) -> Arrays:
        times = np.arange(self.frames) * self._every / self.scene.frames_per_second
        return [(Field("time", ("time",), times.shape, "<f8", "s", "times of the frames"), times)]


def _static(plan: ModelPlan) -> Arrays:
    """Return the meshes of all balloons as one."""
    meshes = [shape.mesh for shape in plan.shapes]
    counts = [mesh.vertex_count for mesh in meshes]
    begins = (np.cumsum(counts) - counts).astype(np.int32)
    parts = {
        "rest_pos": [mesh.points for mesh in meshes],
        "mass_share": [shape.mass_share for shape in plan.shapes],
        "particle_balloon": [np.full(count, number) for number, count in enumerate(counts)],
        "edges": [edges_of(mesh) + begin for mesh, begin in zip(meshes, begins, strict=True)],
        "triangles": [triangulate(mesh)[0] + begin for mesh, begin in zip(meshes, begins, strict=True)],
    }
    arrays = {name: np.concatenate(of_meshes) for name, of_meshes in parts.items()}
    return [
        (Field(name, dimensions, arrays[name].shape, dtype, unit, meaning), arrays[name].astype(dtype))
        for name, dimensions, dtype, unit, meaning in STATIC
    ]


STATIC = (
    ("rest_pos", ("particle", "axis"), "<f4", "m", "rest shape: the mesh as the scene places it"),
    ("mass_share", ("particle",), "<f4", "1", "share of a particle in its balloon's mass, 0 if pinned"),
    ("particle_balloon", ("particle",), "<i4", "1", "balloon of a particle, from 0"),
    ("edges", ("edge", "end"), "<i4", "1", "particles at the ends of each side of a face, once"),
    ("triangles", ("triangle", "corner"), "<i4", "1", "particles at the corners of triangles, counterclockwise"),
)
"""Name, dimensions, kind, unit and meaning of arrays that stay"""


def _targets(scene: Scene, path: str, values: Any) -> list[str]:
    """Find the values of a scene that a path sets, such as `balloon.0.mass` for `balloon.mass`."""
    if is_mesh(path):
        distinct = [Path("one"), Path("another")]  # of which only the names are looked at
    else:
        distinct = [values[0], next((value for value in values if value != values[0]), None)]
    try:
        first, second = (_flat(describe_scene(override_scene(scene, [(path, value)]))) for value in distinct)
    except (InputError, TypeError):
        return []
    return [name for name, value in first.items() if second.get(name) != value]


def _flat(table: Any, path: str = "") -> dict[str, Attribute]:
    """Return the numbers and words of nested tables by dotted paths."""
    if isinstance(table, Mapping | list):
        pairs = table.items() if isinstance(table, Mapping) else enumerate(table)
        below = [_flat(value, f"{path}.{name}" if path else str(name)) for name, value in pairs]
        return {name: value for each in below for name, value in each.items()}
    if isinstance(table, bool):
        return {path: int(table)}
    return {path: table} if isinstance(table, int | float | str) and path != "description" else {}


SPLITS = ("train", "validation", "test")
OF_TEN = (8, 1, 1)
"""Number of each ten worlds that go to each split"""


def splits_of(world_count: int, seed: int) -> NDArray[np.int64]:
    """Draw the split of each world, a number of `SPLITS`, shape (world_count,).

    Each ten worlds in a row have eight for training, one for validation and one for test. The split of a world depends
    on the seed and its number alone, so that a larger batch keeps it.
    """
    ten = np.repeat(np.arange(len(SPLITS)), OF_TEN)
    tens = [np.random.default_rng([seed, number]).permutation(ten) for number in range(-(-world_count // len(ten)))]
    return np.concatenate([np.zeros(0, dtype=np.int64), *tens])[:world_count]


@described
@dataclass(frozen=True)
class TrajectoryFiles(Shown):
    """Files of a batch's trajectories, one for each world, in folders for training, validation and test.

    Raises:
        InputError: a value cannot be.
        MissingExtraError: the format is "h5", and h5py is not installed.
    """

    folder: str | Path
    """Folder, made if it is not there"""
    every: int = 1
    """Step between frames that are written: 2 for every second"""
    format: Literal["h5", "zarr", "npz"] = "h5"
    seed: int = 0
    """Seed of the splits"""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.every < 1:
            raise InputError(f"every {self.every}: expected a whole number of at least 1")
        if self.seed < 0:
            raise InputError(f"seed {self.seed}: expected a whole number of at least 0")
        format_named(self.format)

    @classmethod
    def of(cls, given: "TrajectoryFiles | str | Path | None") -> "TrajectoryFiles | None":
        """Return the options, made of a folder alone if need be."""
        return cls(given) if isinstance(given, str | Path) else given

    def as_json(self) -> dict[str, Any]:
        """Describe the options for a manifest, which tells nobody where the folder was."""
        return {"folder": Path(self.folder).name, "every": self.every, "format": self.format, "seed": self.seed}


TrajectoryFilesLike = TypeAliasType("TrajectoryFilesLike", TrajectoryFiles | str | Path)
"""Files of trajectories, or a folder for them with the defaults"""


@dataclass(frozen=True)
class Moments:
    """Count, mean and sum of squared differences from it, of each component (Chan et al. 1983)."""

    count: int
    mean: NDArray[np.float64]
    squares: NDArray[np.float64]

    @classmethod
    def of(cls, field: Field, values: NDArray) -> Self:
        """Return the moments of an array, by pieces: of vectors by component, of other arrays of all numbers."""
        components = field.shape[-1] if field.dimensions[-1] in AXES else 1
        total, rows = cls(0, np.zeros(components), np.zeros(components)), chunk_shape(field)[0]
        for begin in range(0, len(values), rows):
            piece = values[begin : begin + rows].reshape(-1, components).astype(np.float64)
            mean = piece.mean(axis=0)
            total = total.with_more(cls(len(piece), mean, ((piece - mean) ** 2).sum(axis=0)))
        return total

    def with_more(self, other: Self) -> Self:
        """Return the moments of both together."""
        count = self.count + other.count
        if not count:
            return self
        apart, share = other.mean - self.mean, other.count / count
        mean = self.mean + share * apart
        return type(self)(count, mean, self.squares + other.squares + apart**2 * self.count * share)

    def as_json(self) -> dict[str, Any]:
        """Describe the moments for a manifest: numbers of vectors by component, or a number."""
        deviation = np.sqrt(self.squares / max(self.count, 1))
        told = {"mean": self.mean.tolist(), "deviation": deviation.tolist()}
        return {name: numbers if len(numbers) > 1 else numbers[0] for name, numbers in told.items()}


MANIFEST_NAME = "manifest.json"
STATIC_FOLDER = "static"
"""Name of the folder of static fields, and the beginning of its files' names"""


def listed_files(folder: Path) -> set[str]:
    """List the files that an earlier manifest names; none where there is none, or it is something else."""
    try:
        said = json.loads((folder / MANIFEST_NAME).read_text(encoding="utf-8"))
        names = {name for split in SPLITS for name in said["splits"][split]} | set(said.get("static", ()))
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    ours = rf"(({'|'.join(SPLITS)})/world|{STATIC_FOLDER}/{STATIC_FOLDER})_\d+\.\w+"
    return {name for name in names if re.fullmatch(ours, str(name))}


BLOCK_BYTES = 2**28
"""Size of the frames that are written together: many small writes would take longer"""
PARTIAL_NAME = "partial"
THREADS = min(os.cpu_count() or 1, 16)
"""Number of files that are compressed at the same time"""


class TrajectoryWriter:
    """Writes the files of worlds into the folder `partial`, from which they move to their places once all are whole.

    Frames of a world may come in any order, and again. A world that blew up repeats its last good frame.

    Args:
        options: where they go, and how.
        contents: of the files.
        groups: the worlds, as they come together.
        job: description of the batch; the same when a batch goes on.

    Raises:
        InputError: the folder cannot be written to, or has files of somebody else; or the disk is too small.
    """

    def __init__(self, options: TrajectoryFiles, contents: Contents, groups: Sequence[Group], job: Mapping[str, Any]):
        self.options, self._contents, self._groups = options, contents, groups
        self.folder = _prepared(Path(options.folder))
        self._partial = PartialFolder(self.folder / PARTIAL_NAME)
        self._partial.require_own()
        self._job = as_json({"trajectories": options.as_json(), **job})
        self._format = FORMATS[options.format]()
        self._statics: dict[str, Arrays] = {}
        """Static fields, by the names of their files"""
        self._commons = self._with_static(contents)
        self.world_count = sum(len(group.worlds) for group in groups)
        self._splits = splits_of(self.world_count, options.seed)
        there = [number for number, split in enumerate(SPLITS) if (self.folder / split).exists()]
        names = map(self._name, np.flatnonzero(np.isin(self._splits, there)).tolist())
        statics = self._statics if (self.folder / STATIC_FOLDER).exists() else ()
        require_ours_in(self.folder, [MANIFEST_NAME, *statics, *names], (MANIFEST_NAME, f"{PARTIAL_NAME}/{JOB_NAME}"))
        self._waiting: list[list[Record]] = [[] for _ in groups]
        self._waiting_bytes = 0
        self._safe = False
        """Whether a checkpoint counts on the frames that are there"""
        _require_disk(self.folder, sum(len(g.worlds) * _size(c) for g, c in zip(groups, self._commons, strict=True)))

    def begin(self, resumed: bool) -> None:
        """Create all files; or go on with those of an earlier batch.

        Raises:
            InputError: they cannot be written, or are not there.
        """
        with self._telling():
            if resumed:
                self._take_up()
                return
            self._partial.begin(self._job)
            for group, common in zip(self._groups, self._commons, strict=True):
                for world in group.worlds.tolist():
                    make_room(self._path(world), common.moving)

    def add(self, group: int, record: Record) -> None:
        """Add a frame of a group."""
        if record.tracks is not None:
            self._waiting[group].append(record)
            self._waiting_bytes += sum(values.nbytes for values in record.tracks.values())
        if self._waiting_bytes >= BLOCK_BYTES:
            self.flush()

    def replace(self, group: int, rows: NDArray[np.integer], record: Record) -> None:
        """Replace a frame of some worlds of a group, by their numbers in it."""
        if record.tracks is not None:
            self.flush()
            with self._telling():
                self._write(group, rows, [record])

    def flush(self) -> None:
        """Write all frames that wait."""
        with self._telling():
            for number, records in enumerate(self._waiting):
                for run in _runs(records, self.options.every):
                    self._write(number, np.arange(len(self._groups[number].worlds)), run)
                records.clear()
        self._waiting_bytes = 0

    def save(self) -> None:
        """Write all frames that wait to the disk, for a checkpoint."""
        self.flush()
        os.sync()
        self._safe = True

    def finish(self, health: NDArray[np.integer]) -> None:
        """Put all files into their places, and the manifest beside them.

        Args:
            health: of each world at the end, shape (world_count,).

        Raises:
            InputError: they cannot be written.
        """
        self.flush()
        with self._telling():
            whole = {name: self._finished_static(name) for name in self._statics}
            worlds = dict(self._finished(health))
            whole |= {self._name(world): path for world, (path, _) in worlds.items()}
            os.sync()
            old = listed_files(self.folder)
            (self.folder / MANIFEST_NAME).unlink(missing_ok=True)  # a folder without one is not whole
            for name in (STATIC_FOLDER, *SPLITS):
                (self.folder / name).mkdir(exist_ok=True)
            for name, path in whole.items():
                _move(path, self.folder / name, self._partial.path)
            for name in old - whole.keys():
                _remove(self.folder / name)
        names, moments = [name for name in whole if name not in self._statics], _together(worlds)
        self._write_manifest(names, health, moments)

    def give_up(self) -> None:
        """Remove files that no checkpoint counts on, after a failure."""
        if not self._safe:
            with suppress(InputError):
                self._partial.remove()
            with suppress(OSError):  # there are other files
                self.folder.rmdir()

    def _take_up(self) -> None:
        """Go on with the files of an earlier batch, of which some may be in their places already."""
        if self._partial.job() != self._job:
            raise InputError(
                f"--resume: {self._partial.path} lacks the trajectories of this batch; expected the files written so "
                "far, or no --resume to start over"
            )
        self._partial.go_on()
        self._safe = True
        for group in self._groups:
            for world in group.worlds.tolist():
                if not (path := self._path(world)).exists():
                    raise InputError(f"{path}: is missing; expected the frames of world {world}")

    def _with_static(self, contents: Contents) -> list[WorldFile]:
        """Return the common contents of the files of each group, and note the static arrays that they share."""
        commons: list[WorldFile] = [contents.of_group(group) for group in self._groups]
        known: dict[bytes, str] = {}
        for number in np.argsort([group.worlds[0] for group in self._groups]).tolist():  # the same in any cut
            common = commons[number]
            same = sha256(b"".join(values.tobytes() for _, values in common.static)).digest()
            name = known.setdefault(same, f"{STATIC_FOLDER}/{STATIC_FOLDER}_{len(known):06d}{self._format.suffix}")
            self._statics[name] = common.static
            commons[number] = replace(common, attributes={**common.attributes, STATIC_FOLDER: name})
        return commons

    def _write_manifest(
        self, names: Sequence[str], health: NDArray[np.integer], moments: Mapping[str, Moments]
    ) -> None:
        """Write the manifest, after the files that it names.

        Args:
            names: of the files, by world.
            health: of each world at the end.
            moments: of each moving field, over the files for training, if there are any.

        Raises:
            InputError: it cannot be written.
        """
        options, contents, world = self.options, self._contents, self._commons[0]
        manifest: dict[str, Any] = {
            "format": options.format,
            "frames": contents.frames,
            "every": options.every,
            "time_step": options.every / contents.scene.frames_per_second,
            "seed": options.seed,
            "static": list(self._statics),
            "splits": {split: [name for name in names if name.startswith(f"{split}/")] for split in SPLITS},
            "blew_up": [name for name, well in zip(names, health.tolist(), strict=True) if well == 0],
            "restarted": [name for name, well in zip(names, health.tolist(), strict=True) if well == 2],
            "fields": {
                **{field.name: field.as_json() for field, _ in (*world.static, *world.times)},
                **{
                    field.name: field.as_json() | (moments[field.name].as_json() if field.name in moments else {})
                    for field in world.moving
                },
            },
            "vary": contents.columns,
            "units": json.loads(str(world.attributes["units"])),
            **contents.described,
            "versions": installed_versions(),
        }
        with whole_file(self.folder / MANIFEST_NAME) as path:
            path.write_text(manifest_text(manifest), encoding="utf-8")

    def _finished_static(self, name: str) -> Path:
        return self._written(name, FileContents({}, self._statics[name]))

    def _finished(self, health: NDArray[np.integer]) -> Iterator[tuple[int, tuple[Path, dict[str, Moments]]]]:
        """Write the files of all worlds, in their order; return them with the moments of those for training."""
        groups = np.zeros(self.world_count, dtype=np.int64)
        for number, group in enumerate(self._groups):
            groups[group.worlds] = number

        def finish(world: int) -> tuple[Path, dict[str, Moments]]:
            contents = self._contents.of_world(self._commons[groups[world]], world, int(health[world]))
            frames = all_frames(self._path(world), contents.moving)
            elsewhere = [field.name for field, _ in contents.static]
            path = self._written(
                self._name(world), FileContents(contents.attributes, [*contents.times, *frames], elsewhere)
            )
            learned = frames if self._splits[world] == SPLITS.index("train") else []
            return path, {field.name: Moments.of(field, values) for field, values in learned}

        with ThreadPoolExecutor(THREADS, thread_name_prefix="packer") as threads:
            yield from enumerate(threads.map(finish, range(self.world_count)))

    def _written(self, name: str, contents: FileContents) -> Path:
        """Write a file beside the frames, and return it."""
        path = self._partial.path / Path(name).name
        _remove(path)  # of a batch that was stopped here
        self._format.write(path, contents)
        return path

    def _write(self, group: int, rows: NDArray[np.integer], records: Sequence[Record]) -> None:
        """Write frames that follow each other."""
        moving = self._commons[group].moving
        begin = records[0].number // self.options.every
        health = np.stack([record.healthy for record in records]).astype(np.int32)
        for place, row in enumerate(rows.tolist()):
            path = self._path(int(self._groups[group].worlds[row]))
            arrays = {"health": health[:, place]}
            for field in moving[:-1]:
                arrays[field.name] = np.stack([(record.tracks or {})[field.name][place] for record in records])
            bad = np.flatnonzero(arrays["health"] == 0)
            if len(bad):
                _freeze(arrays, all_frames(path, moving), begin, int(bad[0]))
            put_frames(path, moving, begin, arrays)

    def _path(self, world: int) -> Path:
        return self._partial.path / f"world_{world:06d}{SUFFIX}"

    def _name(self, world: int) -> str:
        return f"{SPLITS[self._splits[world]]}/world_{world:06d}{self._format.suffix}"

    @contextmanager
    def _telling(self) -> Iterator[None]:
        """Tell of a file that cannot be written in a sentence."""
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error).partition("\n")[0]
            raise InputError(f"{self.folder}: trajectories cannot be written: {reason}") from None


def remove_partial(options: TrajectoryFiles | None) -> None:
    """Remove the files for a resumption, once all of the batch is there."""
    if options:
        PartialFolder(Path(options.folder) / PARTIAL_NAME).remove()


def _prepared(folder: Path) -> Path:
    """Return the folder, which is made if it is not there."""
    try:
        folder = target_of(folder)
        folder.mkdir(exist_ok=True)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise InputError(f"{folder}: cannot be written: Permission denied")
    except FileNotFoundError:
        raise InputError(f"{folder}: the folder {folder.parent} does not exist") from None
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{folder}: is a file; expected a folder") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    return folder


def _require_disk(folder: Path, needed: int) -> None:
    if needed > (free := shutil.disk_usage(folder).free):
        raise InputError(
            f"{folder}: the trajectories need {needed / 2**30:.2f} GiB, and the disk has {free / 2**30:.2f} GiB; "
            "expected more room, fewer worlds or a larger --every"
        )


def _size(world: WorldFile) -> int:
    """Return the size of a world's frames, and that of its file, which compression makes smaller by an unknown part."""
    return 2 * sum(field.bytes for field in world.moving)


def _together(worlds: Mapping[int, tuple[Path, dict[str, Moments]]]) -> dict[str, Moments]:
    """Return the moments of all worlds that have them."""
    total: dict[str, Moments] = {}
    for _, moments in worlds.values():
        for name, more in moments.items():
            total[name] = total[name].with_more(more) if name in total else more
    return total


def _runs(records: Sequence[Record], every: int) -> Iterator[list[Record]]:
    """Split records where one does not follow the one before."""
    run: list[Record] = []
    for record in records:
        if run and record.number != run[-1].number + every:
            yield run
            run = []
        run.append(record)
    if run:
        yield run


def _freeze(arrays: Mapping[str, NDArray], frames: Arrays, begin: int, bad: int) -> None:
    """Repeat the last good frame from a bad one on."""
    for field, written in frames[:-1]:
        values = arrays[field.name]
        if bad:
            values[bad:] = values[bad - 1]
        else:
            values[:] = written[begin - 1] if begin else 0.0


def _move(path: Path, place: Path, aside: Path) -> None:
    """Move a file or folder to its place, where there may be an earlier one."""
    if path.is_dir() and place.exists():
        place.rename(aside / f"earlier_{place.name}")
    os.replace(path, place)


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
