"""Report of a run or batch: its summary, advice and provenance as it begins, and its outcome.

A bad ending is a balloon that came apart, fell for ever, collapsed, swelled, swallowed parts or folded. Cheap measures
of the last frame's points beside the mesh, on the host, in NumPy, find it. The bounds are far from the endings of the
bundled scenes, and near to those of balloons in ruins (tests/test_diagnosis.py).
"""

import copy
import hashlib
import inspect
import platform
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from balloon_warp.frame import Frame
from balloon_warp.kernels.laws import Law
from balloon_warp.kernels.laws.springs import KINDS
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.load import size_of
from balloon_warp.mesh.repair import wrong_sides
from balloon_warp.mesh.topology import (
    corner_faces,
    face_areas,
    face_vector_areas,
    mesh_edges,
    signed_volume,
    total_area,
    vertex_components,
)
from balloon_warp.model import Model, ModelPlan, plan_model
from balloon_warp.model.obstacles import obstacle_motion
from balloon_warp.model.parameters import Parameters
from balloon_warp.model.pressure import volume_under
from balloon_warp.model.shape import BalloonShape, constants_of
from balloon_warp.scene import Scene, load_scene
from balloon_warp.scene.load import FILES, files_of, is_there
from balloon_warp.scene.scene import MESHED, WITHOUT_MESHES
from balloon_warp.springs.even import film_tension
from balloon_warp.system.files import legible
from balloon_warp.system.warp_threads import lock_of

if TYPE_CHECKING:
    from balloon_warp.model import Model


ABSOLUTE = re.compile(r"(?<![^=,])(?:~[^/=,]*)?/(?:[^/=,]+/)*")
"""Folders of an absolute path, which begins a word or a value in it"""
LIBRARIES = ("balloon-warp", "warp-lang", "numpy", "scipy", "usd-core")


def describe_scene(scene: Scene) -> dict[str, Any]:
    """Describe a scene as JSON has it. A mesh from Python has its name only."""
    described = scene.model_dump(mode="json", exclude=WITHOUT_MESHES)
    for name in MESHED:
        for table, meshed in zip(described[name], getattr(scene, name), strict=True):
            if meshed.mesh is not None:
                table["mesh"] = mesh_label(meshed.mesh)
    return described


def describe_simulation(scene: Scene, laws: Iterable[Law], substeps: int) -> dict[str, Any]:
    """Describe the scene and the laws, files and versions it runs with. Before the run: files may change meanwhile."""
    return {
        "scene": describe_scene(scene),
        "laws": describe_laws(laws),
        "files": hash_files(scene),
        "substeps": substeps,
        "versions": installed_versions(),
    }


def hash_files(scene: Scene) -> dict[str, str]:
    """Hash each file that a scene names, and each mesh from Python, by its place, such as `balloon.0.mesh`."""
    hashes = {}
    for name in MESHED:
        for number, table in enumerate(getattr(scene, name)):
            files = files_of(table) | ({"mesh": table.mesh} if isinstance(table.mesh, PolygonMesh) else {})
            hashes |= {f"{name}.{number}.{place}": hash_of_mesh(file) for place, file in files.items()}
    return hashes


def without_folders(description: Mapping[str, Any]) -> dict[str, Any]:
    """Describe the same as it is wherever the files are: those of its `scene` lose their folders."""
    scene = copy.deepcopy(description["scene"])
    for table, field in named_files(scene).values():
        table[field] = Path(table[field]).name
    return {**description, "scene": scene}


def named_files(scene: Mapping[str, Any]) -> dict[str, tuple[dict[str, Any], str]]:
    """Find where a scene as JSON names files: tables and their fields, by places such as `balloon.0.mesh`."""
    found = {}
    for name in MESHED:
        for number, table in enumerate(scene.get(name, ())):
            for file in FILES:
                *within, field = file.split(".")
                holder = table.get(within[0]) if within else table
                if holder and isinstance(holder.get(field), str):
                    found[f"{name}.{number}.{file}"] = holder, field
    return found


def command_without_folders(words: Iterable[str]) -> list[str]:
    """Return the words of a command, of which absolute paths lose their folders."""
    return [ABSOLUTE.sub("", word) for word in words]


def describe_laws(laws: Iterable[Law]) -> dict[str, dict[str, str]]:
    """Hash each law's functions, as their source has them, by its name (SHA-256)."""
    described = {}
    for law in laws:
        functions = {"force": law.force} | ({"energy": law.energy} if law.energy else {})
        described[law.name] = {what: _hash_of_source(function.func) for what, function in functions.items()}
    return described


def installed_versions() -> dict[str, str]:
    """Return the versions of Python, and of the libraries that a result depends on."""
    installed = {"python": platform.python_version()}
    for library in LIBRARIES:
        try:
            installed[library] = metadata.version(library)
        except metadata.PackageNotFoundError:  # an extra, or a source tree
            continue
    return installed


def hash_of_file(path: Path) -> str:
    """Return SHA-256 of its bytes, in hexadecimal digits, as `sha256sum` prints it."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _hash_of_source(function: Any) -> str:
    return hashlib.sha256(inspect.getsource(function).encode()).hexdigest()


def hash_of_mesh(mesh: str | Path | PolygonMesh) -> str:
    """Return SHA-256 of a mesh's file; of one that came from Python, of its arrays, one after the other."""
    if not isinstance(mesh, PolygonMesh):
        return hash_of_file(Path(mesh))
    arrays = (mesh.points, mesh.face_vertex_counts, mesh.face_vertex_indices)
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def mesh_label(mesh: str | Path | PolygonMesh) -> str:
    """Return a mesh's file, or the name of a mesh made in Python."""
    return mesh.name if isinstance(mesh, PolygonMesh) else legible(str(mesh))


@dataclass(frozen=True)
class RunHeader:
    """Size of a simulation, its device and its schedule."""

    worlds: int
    particles: int
    """Number of particles of all worlds together"""
    frames: int
    substeps: int
    """Number of substeps in a frame; where meshes differ, of the first"""
    frames_per_second: float
    """Frame rate of the stage [1/s]"""
    device: str
    schedule: str
    workers: int = 1
    """Number of processes that simulate"""
    many_substeps: str | None = None
    """Sentence on the cause of many substeps of a mesh by itself, and its remedy; None if there are few"""
    strain_bound: str | None = None
    """Sentence on film that is softer than its material, and the substeps that this spares; None without such film"""
    coarse: str | None = None
    """Sentence on a mesh by itself whose faces show, and its remedy; else None"""

    @classmethod
    def of(cls, model: "Model", schedule: str) -> Self:
        """Summarize a model before its first frame."""
        from balloon_warp.model.stability import strain_bound_sentence

        return cls(
            worlds=model.world_count,
            particles=model.world_count * model.particle_count,
            frames=model.scene.frames,
            substeps=model.substeps,
            frames_per_second=model.scene.frames_per_second,
            device=str(model.device),
            schedule=schedule,
            many_substeps=many_substeps_sentence(model.scene, model.shapes, model.substeps),
            strain_bound=strain_bound_sentence(model),
            coarse=coarse_sentence(model.scene, model.shapes),
        )


FALLEN = 5.0
"""Fall below the start, over the balloon's size, from which on a balloon with nothing below it counts as falling
forever"""
DRIFTED = 0.5
"""Distance of a part from the largest part, over the balloon's size, beyond the balloon's growth"""
LEAST_VOLUME, LEAST_AREA, LEAST_RADIUS = 0.25, 0.25, 0.5
"""Least fraction of the mesh's value; the radius is the root mean square distance from the center"""
LEAST_INFLATED_VOLUME, LEAST_HEIGHT = 0.9, 0.8
"""Least fraction of the mesh's value for an undisturbed balloon with an "auto" pressure, which should grow and stand"""
MOST_SWOLLEN = 1.6
"""Largest volume at an "auto" pressure, over that of a sphere with the requested stretch"""
MOST_WRONG_SIDED = 0.05
"""Largest additional fraction of the area, over the mesh's own, that is enclosed by other parts, or inside out"""
COMPACT = 0.005
"""Least volume over area^(3/2) of a mesh whose volume is meaningful: 0.094 for a sphere, 0.048 for a pillow"""
MOST_FOLDS = 0.01
"""Largest fraction of edges that are folded"""
FOLDED, UNFOLDED = -0.7, -0.2
"""Cosines between the normals of two faces that share an edge: folded below the first, and not above the second"""


@dataclass(frozen=True)
class Swelling:
    """Result of an "auto" pressure."""

    balloon: str
    pressure: float
    """Pressure [Pa]"""
    volume: float | None
    """Volume in equilibrium with the springs, without weight, over that at the start; None where it is not predicted:
    for open balloons, rubber and film, and large meshes"""

    def __str__(self) -> str:
        volume = "" if self.volume is None else f", volume 1.00 -> {self.volume:.2f}"
        return f"auto pressure {self.pressure:.4g} Pa{volume}"


def swellings(scene: Scene, shapes: Sequence[BalloonShape], parameters: Parameters) -> list[Swelling]:
    """Return the swelling of each balloon that an "auto" pressure inflates, in the first world."""
    found = []
    for number, (balloon, shape) in enumerate(zip(scene.balloon, shapes, strict=True)):
        pressure = float(parameters["keyframe_values"][0, number, -1]) if balloon.inflation.is_automatic else 0.0
        if pressure and shape.inflated:
            constants = np.array([parameters[row.name][0, number] for row in KINDS])
            volume = None if shape.membrane.count else volume_under(shape, constants, pressure)
            found.append(Swelling(shape.name, pressure, volume))
    return found


def swellings_of(model: Model) -> list[Swelling]:
    """Predict the swellings of a model."""
    names = ("keyframe_values", *(row.name for row in KINDS))
    with lock_of(model.device):
        read = {name: np.asarray(model.parameters[name].numpy(), dtype=np.float64) for name in names}
    return swellings(model.scene, model.shapes, read)


def predicted_swellings(scene: Scene) -> list[Swelling]:
    """Predict the swellings of a scene.

    Raises:
        InputError: as `plan_model`.
    """
    plan = plan_model(scene)
    return swellings(plan.scene, plan.shapes, plan.parameters)


def swelling_sentences(found: Sequence[Swelling]) -> list[str]:
    """Return sentences on the swelling of balloons, with the balloon's name where there are several."""
    return [f"{each.balloon}: {each}" if len(found) > 1 else str(each) for each in found]


@dataclass(frozen=True)
class BadEnding:
    """Bad ending of a balloon."""

    kind: Literal["falling", "drifted", "collapsed", "swollen", "swallowed", "folded"]
    balloon: str
    """Name of the balloon"""
    measure: float
    """Size of the defect: sizes fallen; distance of a part over the balloon's size; remaining fraction of the volume,
    area, size or height, negative where inside out; volume over the expected one; fraction of the area that is enclosed
    or inside out; fraction of the edges that are folded"""
    sentence: str

    def __str__(self) -> str:
        return self.sentence


class LastFrame(NamedTuple):
    """State of a world's last frame."""

    number: int
    points: Sequence[NDArray[np.floating]]
    """Positions of each balloon's particles [m], shape (particle_count, 3)"""
    velocities: Sequence[NDArray[np.floating]]
    """Velocities of each balloon's particles [m/s], shape (particle_count, 3)"""
    obstacle_poses: NDArray[np.float64]
    """Poses of obstacles as in `Frame`, shape (obstacle_count, 7)"""
    torn: Sequence[NDArray[np.bool_]] = ()
    """Masks of torn faces as in `Frame`"""


def bad_endings(model: Model | ModelPlan, frame: Frame | LastFrame) -> list[BadEnding]:
    """Find the balloons of a world that ended badly, each with its gravest defect, in the scene's order.

    Args:
        model: the simulated model.
        frame: the last one.
    """
    found = (_ending(model, frame, number) for number in range(len(model.shapes)))
    return [ending for ending in found if ending]


def ending_sentences(endings: Sequence[BadEnding]) -> list[str]:
    """Return one sentence for each kind: of the first balloon, and how many others there are."""
    counts = Counter(ending.kind for ending in endings)
    firsts = {ending.kind: ending for ending in reversed(endings)}
    more = {kind: f" (and {count - 1} more like it)" if count > 1 else "" for kind, count in counts.items()}
    return [f"{firsts[kind]}{more[kind]}" for kind in counts]


def _ending(model: Model | ModelPlan, frame: Frame | LastFrame, number: int) -> BadEnding | None:
    rest = model.shapes[number].mesh
    end = replace(rest, points=frame.points[number].astype(np.float64))
    used = np.unique(rest.face_vertex_indices)
    if (model.shapes[number].mass_share[used] == 0.0).all() or rest.face_vertex_counts.max() < 3:
        return None
    if frame.torn and frame.torn[number].any():
        return None  # it burst, as it was told
    return (
        _falling(model, frame, number, used)
        or _drifted(rest, end, used)
        or _collapsed(rest, end, used, model.shapes[number].closed)
        or (_misshapen(model, rest, end, number) if model.shapes[number].closed else None)
        or _folded(rest, end)
    )


def _falling(
    model: Model | ModelPlan, frame: Frame | LastFrame, number: int, used: NDArray[np.integer]
) -> BadEnding | None:
    scene, shape = model.scene, model.shapes[number]
    tied = [string for string in scene.string if string.balloon == number and is_there(scene, string, frame.number)]
    if scene.ground or tied or (shape.mass_share[used] == 0.0).any():
        return None
    up, start = np.array(scene.up), shape.mesh.points[used]
    if _lands(model, frame, frame.points[number][used].astype(np.float64), up):
        return None
    fallen = float((start - frame.points[number][used]).mean(axis=0) @ up) / _size(start)
    if fallen < FALLEN or float(frame.velocities[number][used].mean(axis=0) @ up) >= 0.0:
        return None
    sentence = f"{shape.name} falls forever: {fallen:.0f} times its size below the start; a [ground] would stop it"
    return BadEnding("falling", shape.name, fallen, sentence)


def _lands(
    model: Model | ModelPlan, frame: Frame | LastFrame, points: NDArray[np.float64], up: NDArray[np.float64]
) -> bool:
    """Return whether an obstacle is, or may be, below a balloon's points.

    It counts as wide as it reaches.
    """
    center = points.mean(axis=0)
    sideways = (points - center) - np.outer((points - center) @ up, up)
    radius, lowest = float(np.linalg.norm(sideways, axis=1).max()), float((points @ up).min())
    for shape, pose in zip(model.obstacles, frame.obstacle_poses, strict=True):
        if shape.kind == "plane":
            from scipy.spatial.transform import Rotation  # takes long to load

            if Rotation.from_quat(pose[3:]).apply(up) @ up > 0.0:
                return True
            continue
        arm = center - pose[:3]
        apart = float(np.linalg.norm(arm - (arm @ up) * up))
        if apart < radius + shape.reach and lowest > pose[:3] @ up - shape.reach:
            return True
    return False


def _drifted(rest: PolygonMesh, end: PolygonMesh, used: NDArray[np.integer]) -> BadEnding | None:
    """Return a bad ending if a part has drifted away from the largest one, however the balloon is rotated.

    Parts are components connected by edges.
    """
    parts, part_of, sizes = np.unique(
        vertex_components(rest, mesh_edges(rest))[used], return_inverse=True, return_counts=True
    )
    if len(parts) < 2:
        return None
    before, after = (_distances(mesh.points[used], part_of, sizes) for mesh in (rest, end))
    growth = max(1.0, (total_area(end) / max(total_area(rest), 1e-300)) ** 0.5)
    off = (after - growth * before) / _size(rest.points[used])
    if off.max() < DRIFTED:
        return None
    count, far = int(np.count_nonzero(off > DRIFTED)), float(after[off.argmax()])
    which = "a part" if count == 1 else f"{count:,} parts"
    sentence = f"{rest.name} came apart: {which} of its {len(parts):,} drifted off, up to {far:.3g} m from the largest"
    return BadEnding("drifted", rest.name, float(off.max()), sentence)


def _distances(
    points: NDArray[np.float64], part_of: NDArray[np.integer], sizes: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Return distances from the center of each part to that of the largest, shape (part_count,)."""
    centers = np.stack([np.bincount(part_of, points[:, axis]) for axis in range(3)], axis=1) / sizes[:, None]
    return np.linalg.norm(centers - centers[sizes.argmax()], axis=1)


def _collapsed(rest: PolygonMesh, end: PolygonMesh, used: NDArray[np.integer], closed: bool) -> BadEnding | None:
    area = total_area(rest)
    left = {
        "area": (total_area(end) / max(area, 1e-300) if area else 1.0, LEAST_AREA),
        "size": (_radius(end.points[used]) / max(_radius(rest.points[used]), 1e-300), LEAST_RADIUS),
    }
    volume = signed_volume(rest)
    if closed and volume > COMPACT * area**1.5:
        left = {"volume": (signed_volume(end) / volume, LEAST_VOLUME), **left}
    for what, (part, least) in left.items():
        if part < 0.0:
            sentence = f"{rest.name} turned inside out: its volume is {part:.2f} times that of its mesh"
            return BadEnding("folded", rest.name, part, sentence)
        if part < least:
            helps = "more pressure, stiffer springs or less weight helps"
            sentence = f"{rest.name} collapsed to {part:.0%} of the {what} of its mesh; {helps}"
            return BadEnding("collapsed", rest.name, part, sentence)
    return None


def _misshapen(model: Model | ModelPlan, rest: PolygonMesh, end: PolygonMesh, number: int) -> BadEnding | None:
    """Find a wrong size or sides of a closed balloon that is thick enough for its volume to be meaningful."""
    volume = signed_volume(rest)
    if volume < COMPACT * total_area(rest) ** 1.5:
        return None
    return _wrong_size(model, rest, end, number) or _wrong_sided(rest, end)


def _wrong_size(model: Model | ModelPlan, rest: PolygonMesh, end: PolygonMesh, number: int) -> BadEnding | None:
    balloon, name = model.scene.balloon[number], rest.name
    if not balloon.inflation.is_automatic:
        return None
    grown = signed_volume(end) / signed_volume(rest)
    if grown > MOST_SWOLLEN * (1.0 + balloon.inflation.stretch) ** 3:
        return BadEnding("swollen", name, grown, f"{name} swelled to {grown:.1f} times its volume; less pressure helps")
    if not _is_left_to_itself(model):
        return None
    if grown < LEAST_INFLATED_VOLUME:
        sentence = f"{name} crumpled to {grown:.0%} of the volume of its mesh; less weight or more pressure helps"
        return BadEnding("collapsed", name, grown, sentence)
    height = _height_left(rest, end, np.array(model.scene.up))
    if height < LEAST_HEIGHT:
        sentence = f"{name} sank to {height:.0%} of its height; less weight, more pressure or stiffer springs help"
        return BadEnding("collapsed", name, height, sentence)
    return None


def _is_left_to_itself(model: Model | ModelPlan) -> bool:
    """Return whether nothing but the ground and obstacles at rest presses the balloons of a scene."""
    scene = model.scene
    return len(scene.balloon) == 1 and not (scene.sphere or scene.body) and len(obstacle_motion(scene)) == 1


def _height_left(rest: PolygonMesh, end: PolygonMesh, up: NDArray[np.float64]) -> float:
    """Return the height at the end over the mesh's, along an up axis that has turned with the balloon (Kabsch)."""
    before, after = (mesh.points[np.unique(mesh.face_vertex_indices)] for mesh in (rest, end))
    before, after = before - before.mean(axis=0), after - after.mean(axis=0)
    left, _, right = np.linalg.svd(after.T @ before)
    turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return float(np.ptp(after @ (turn @ up)) / max(np.ptp(before @ up), 1e-300))


def _wrong_sided(rest: PolygonMesh, end: PolygonMesh) -> BadEnding | None:
    """Return the parts that came to lie inside others, or show their inner side."""
    before, after = wrong_sides(rest), wrong_sides(end)
    for new, what in (
        (after.enclosed & ~before.enclosed, "swallowed {} of its surface, now inside other parts"),
        (after.reversed & ~before.reversed, "turned inside out in part: {} of its surface shows its inner side"),
    ):
        part = float(before.areas[new].sum() / before.areas.sum())
        if part > MOST_WRONG_SIDED:
            helps = "less pressure helps, or [touch] with itself = true"
            return BadEnding("swallowed", rest.name, part, f"{rest.name} {what.format(f'{part:.0%}')}; {helps}")
    return None


def _folded(rest: PolygonMesh, end: PolygonMesh) -> BadEnding | None:
    """Return the faces that look against a neighbor, as they did not in the mesh."""
    edges = mesh_edges(rest)
    first = edges.starts[edges.face_counts == 2]
    if not len(first):
        return None
    faces = corner_faces(rest)[edges.corners]
    before, after = (_cosines(mesh, faces[first], faces[first + 1]) for mesh in (rest, end))
    part = float(np.mean((after < FOLDED) & (before > UNFOLDED)))
    if part < MOST_FOLDS:
        return None
    sentence = f"{rest.name} folded over itself: {part:.1%} of its edges are newly folded sharply"
    return BadEnding("folded", rest.name, part, sentence)


def _cosines(mesh: PolygonMesh, first: NDArray[np.integer], second: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return cosines between the normals of faces, 0 where one has no area."""
    areas = face_vector_areas(mesh)
    lengths = np.linalg.norm(areas, axis=1, keepdims=True)
    normals = np.divide(areas, lengths, out=np.zeros_like(areas), where=lengths > 0.0)
    return np.einsum("ij,ij->i", normals[first], normals[second])


def _size(points: NDArray[np.float64]) -> float:
    return max(float(np.ptp(points, axis=0).max()), 1e-300)


def _radius(points: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean()))


MANY = 30
"""Number of substeps of a frame up to which nothing needs to be said"""
USUAL_PARTICLES, USUAL_MASS, USUAL_SUM = 2000.0, 2.0, 3.0
"""Number of particles, mass [kg], and sum of a particle's springs over the skin's tension, of a mesh that takes 14"""
FEW_PARTICLES = 300
"""Number of particles below which a balloon shows its faces"""
LARGE_FACE = 0.1
"""Root of a face's area over the balloon's size above which the face shows"""
OF_FILE = ("prim", "weld", "holes", "parts", "taken", "unit", "up", "scale")
"""Fields of a balloon from which the springs of a mesh by itself follow"""


def coarse_sentence(scene: Scene, shapes: Sequence[BalloonShape]) -> str | None:
    """Return a sentence on a mesh by itself whose faces show, and its remedy; else None."""
    if len(shapes) != 1 or not scene.balloon[0].stiffness.even:
        return None
    mesh = shapes[0].mesh
    largest = float(face_areas(mesh).max()) ** 0.5 / size_of(mesh)
    if mesh.vertex_count >= FEW_PARTICLES and largest <= LARGE_FACE:
        return None
    faces = f"{mesh.vertex_count:,} particles, faces up to {largest:.2g} of its size"
    helps = "balloon-warp remesh --cells 32 makes them small and even"
    return f"{shapes[0].name} is coarse and shows its faces ({faces}): {helps}"


def many_substeps_sentence(scene: Scene, shapes: Sequence[BalloonShape], substeps: int) -> str | None:
    """Return a sentence on the cause of a short step of a mesh by itself, and its remedy; else None.

    Masses lie where springs are stiff, so that the frequency squared goes with the sum of all constants over the mass.
    So one of these is unusual: the number of particles, the mass, or springs of a kind.

    Args:
        substeps: in a frame.
    """
    if substeps <= MANY or len(shapes) != 1 or not scene.balloon[0].stiffness.even:
        return None
    if scene.balloon[0].material.is_membrane:
        return _membrane_sentence(scene, substeps)
    shape, mass, constants = shapes[0], scene.balloon[0].mass, constants_of(scene.balloon[0].stiffness)
    tension = film_tension(constants)
    if not tension or not mass:
        return None
    each = constants[shape.springs.kind] * shape.stiffness_scale
    parts = vertex_components(shape.mesh, mesh_edges(shape.mesh))
    across = np.zeros(shape.springs.count, dtype=bool) if shape.across is None else shape.across
    between = ~across & (parts[shape.springs.pairs[:, 0]] != parts[shape.springs.pairs[:, 1]])
    surface = max(float(each[~across & ~between].sum()), 1e-30)
    count = max(int(np.count_nonzero(shape.mass_share)), 1)
    unusual = {
        f"it has {count:,} particles; remesh with fewer --cells helps": count / USUAL_PARTICLES,
        f"its mass of {mass:.3g} kg is small for its springs; more balloon.mass helps": USUAL_MASS / mass,
        "its narrow faces have stiff springs; remesh helps": 2.0 * surface / count / tension / USUAL_SUM,
        'springs across its thin walls are stiff; balloon.stiffness.thin = "alike" or remesh helps': (
            1.0 + float(each[across].sum()) / surface
        ),
        'its parts are tied by stiff springs; balloon.parts = "free" or remesh helps': (
            1.0 + float(each[between].sum()) / surface
        ),
    }
    return f"A frame takes {substeps:,} substeps, since {max(unusual, key=lambda why: unusual[why])}"


def _membrane_sentence(scene: Scene, substeps: int) -> str | None:
    """Compare the step of rubber or film with that of the springs which the mesh would have by itself."""
    (balloon,) = scene.balloon
    kept = {f"balloon.{field}": getattr(balloon, field) for field in OF_FILE if field in balloon.model_fields_set}
    springs = plan_model(load_scene(balloon.mesh, {**kept, "frames_per_second": scene.frames_per_second})).substeps
    if substeps <= springs:
        return None
    material = balloon.material.preset or balloon.material.kind
    return (
        f"A frame takes {substeps:,} substeps, since {material} is stiff for its mass: springs take {springs:,}; "
        'balloon.material.kind = "springs" or remesh with fewer --cells helps'
    )
