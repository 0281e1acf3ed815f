"""Opening of USD stages: limits checked before; shapes and instances as meshes in memory.

Limits of a USD stage, checked before USD reads and composes it: it does neither with a bound.

A stage is refused whose files wait or have no end, are nested deeper than USD's parser stands, or whose references
multiply, run in a circle, or follow each other for long.

Shapes of a USD stage that are no meshes, as meshes, in memory: cubes, spheres, cylinders, capsules, cones, planes.

So whoever reads a stage knows meshes alone. Other kinds of a stage's shapes are named.
"""

import re
import zipfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from balloon_warp.errors import InputError
from balloon_warp.mesh.topology import Faces, box_faces, capsule_faces, cylinder_faces, quad_sphere, rectangle_faces
from balloon_warp.system.files import check_regular, file_behind, legible

LARGEST_STAGE, LARGEST_TEXT = 1 << 40, 1 << 31
"""Largest size of a stage's file, of which USD reads parts on demand, and of one of text [bytes]"""
MOST_DEPTH = 500
"""Largest depth of brackets in a text, and of prims in each other"""
MOST_PRIMS = 1_000_000
"""Largest number of prims of a stage, each as often as references repeat it"""
MOST_ARCS = 100
"""Largest number of references that follow each other"""
MOST_SUBLAYERS = 1_000
"""Largest number of sublayers of a layer, each as often as they repeat it"""
TEXT = b"#usda"
QUOTED = re.compile(
    rb'"""(?:[^\\]|\\.)*?"""|\'\'\'(?:[^\\]|\\.)*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)*\''
    rb"|@@@.*?@@@|@[^@\n]*@|#[^\n]*",
    re.DOTALL,
)
"""Strings, names of files and comments"""
ARCS = {"references": "referenceList", "payload": "payloadList", "inheritPaths": "inheritPathList",
        "specializes": "specializesList"}  # fmt: skip
"""Lists of a prim that bring in others, by their keys"""
Place = tuple[str, Sdf.Path]
"""Root layer of a stack, and the path of a prim in it"""


class Extent(NamedTuple):
    """Most that a prim brings into a stage."""

    prims: int = 1
    arcs: int = 0
    """Longest way of references"""
    depth: int = 1


class Limits:
    """Layers of a stage, and how large they make it.

    Args:
        path: the stage's file, which a sentence names.

    Raises:
        InputError: the stage asks for too much.
    """

    def __init__(self, path: Path):
        self._path = path
        self._layers: dict[str, Sdf.Layer | None] = {}
        self._stacks: dict[str, list[Sdf.Layer]] = {}
        self._known: dict[Place, Extent] = {}
        root = self._layer(str(path))
        if root is not None:
            self._check(self._extent((root.identifier, Sdf.Path.absoluteRootPath)))

    def _check(self, extent: Extent) -> None:
        for what, number, most in (
            ("prims with all that references repeat", extent.prims, MOST_PRIMS),
            ("references that follow each other", extent.arcs, MOST_ARCS),
            ("prims in each other", extent.depth, MOST_DEPTH),
        ):
            if number > most:
                raise InputError(f"{self._path}: has more than {most:,} {what}")

    def _layer(self, name: str) -> Sdf.Layer | None:
        """Return a layer by its identifier; None where it is missing or none."""
        name = Sdf.Layer.SplitIdentifier(name)[0]
        if name not in self._layers:
            file = Path(name.partition("[")[0])
            self._layers[name] = None
            if file.exists():
                check_text(file)
                with suppress(Tf.ErrorException):
                    layer = self._layers[name] = Sdf.Layer.FindOrOpen(name)
                    if layer:  # which may go by another name, as behind a link
                        self._layers[layer.identifier] = layer
        return self._layers[name]

    def _stack(self, root: str) -> list[Sdf.Layer]:
        """Return a layer and its sublayers, each once."""
        if root not in self._stacks:
            found, counts, open_ = dict[str, Sdf.Layer](), 0, [self._layer(root)]
            while open_:
                layer = open_.pop()
                if layer is None:
                    continue
                counts += 1
                if counts > MOST_SUBLAYERS:
                    raise InputError(
                        f"{self._path}: has more than {MOST_SUBLAYERS:,} sublayers, repeated ones included"
                    )
                found[layer.identifier] = layer
                open_ += [self._layer(layer.ComputeAbsolutePath(each)) for each in layer.subLayerPaths]
            self._stacks[root] = [*found.values()]
        return self._stacks[root]

    def _extent(self, start: Place) -> Extent:
        """Return the extent of a prim, with all below it and all that it refers to."""
        open_: list[tuple[Place, list[tuple[Place, int, bool]] | None]] = [(start, None)]
        within = set[Place]()
        while open_:
            place, parts = open_.pop()
            if parts is not None:
                self._known[place] = self._sum(parts)
                within.discard(place)
            elif place in within:
                raise InputError(f"{self._path}: its references go in a circle, through {place[1]}")
            elif place not in self._known:
                within.add(place)
                parts = self._parts(place)
                open_.append((place, parts))
                open_ += [(part, None) for part, _, _ in parts if part not in self._known]
        return self._known[start]

    def _sum(self, parts: list[tuple[Place, int, bool]]) -> Extent:
        prims, arcs, depth = 1, 0, 1
        for part, count, is_arc in parts:
            own = self._known[part]
            prims, arcs = prims + count * own.prims, max(arcs, own.arcs + is_arc)
            depth = max(depth, own.depth + (not is_arc))
        self._check(Extent(prims, arcs, depth))
        return Extent(prims, arcs, depth)

    def _parts(self, place: Place) -> list[tuple[Place, int, bool]]:
        """Return the parts of a prim: the place of each, how often, and whether it is referred to."""
        root, path = place
        specs = [spec for layer in self._stack(root) if (spec := layer.GetPrimAtPath(path))]
        above, own = path, bool(specs)
        while not specs and not above.isEmpty and not above.IsAbsoluteRootPath():  # brought in by a prim around it
            above = above.GetParentPath()
            specs = [spec for layer in self._stack(root) if (spec := layer.GetPrimAtPath(above))]
        found: dict[Place, tuple[int, bool]] = {}
        for spec in specs:
            for each in _with_variants(spec):
                for target, count in self._targets(root, each):
                    found[target] = (found.get(target, (0, True))[0] + count, True)
                if own:
                    for child in each.nameChildren:
                        found[root, path.AppendChild(child.name)] = (1, False)
        return [(part, count, is_arc) for part, (count, is_arc) in found.items() if part != place or is_arc]

    def _targets(self, root: str, spec: Any) -> list[tuple[Place, int]]:
        """Return the targets of a prim's references, and how often it refers to each."""
        found: list[tuple[Place, int]] = []
        for key in ARCS.keys() & set(spec.ListInfoKeys()):
            for each in getattr(spec, ARCS[key]).GetAddedOrExplicitItems():
                if isinstance(each, Sdf.Path):
                    found.append(((root, each), 1))
                    continue
                other = root
                if each.assetPath:
                    layer = self._layer(spec.layer.ComputeAbsolutePath(each.assetPath))
                    if layer is None:
                        continue
                    other = layer.identifier
                    self._layers.setdefault(other, layer)
                layer = self._layers[other]
                default = layer.defaultPrim if layer else ""
                target = each.primPath or (Sdf.Path.absoluteRootPath.AppendPath(default) if default else each.primPath)
                if not target.isEmpty:
                    found.append(((other, target), 1))
        if spec.typeName == "PointInstancer":  # whose instances are to be prims
            numbers, prototypes = spec.attributes.get("protoIndices"), spec.relationships.get("prototypes")
            count = len(numbers.default or ()) if numbers else 0
            targets = prototypes.targetPathList.GetAddedOrExplicitItems() if prototypes else []
            found += [((root, target.MakeAbsolutePath(spec.path)), count) for target in targets]
        return found


def check_text(path: Path) -> None:
    """Make sure that a file of USD, or of a package, is one that its parser reads.

    Raises:
        InputError: it is no regular file, or text that is too long or nested too deeply.
    """
    check_regular(path, most=LARGEST_STAGE)
    try:
        if path.suffix.lower() == ".usdz":
            with zipfile.ZipFile(path) as package:
                for member in package.infolist():
                    if member.filename.lower().endswith((".usda", ".usd")):
                        _check_size(path, member.file_size)
                        _check_depth(path, package.read(member))
            return
        with path.open("rb") as file:
            begin = file.read(len(TEXT))
            if begin == TEXT:
                _check_size(path, path.stat().st_size)
                _check_depth(path, begin + file.read())
    except (OSError, zipfile.BadZipFile, RuntimeError, EOFError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: cannot be read as a USD stage ({error})") from None


def _check_size(path: Path, size: int) -> None:
    if size > LARGEST_TEXT:
        raise InputError(f"{path}: has {size:,} bytes of text; expected at most {LARGEST_TEXT:,}")


def _check_depth(path: Path, text: bytes) -> None:
    if not text.startswith(TEXT):
        return
    steps = np.zeros(256, np.int32)
    steps[list(b"([{")], steps[list(b")]}")] = 1, -1
    bare = np.frombuffer(QUOTED.sub(b"", text), np.uint8)
    depth = np.cumsum(steps[bare[steps[bare] != 0]])
    if depth.max(initial=0) > MOST_DEPTH:
        raise InputError(f"{path}: is nested {depth.max():,} deep; expected at most {MOST_DEPTH}")


def _with_variants(spec: Any) -> list[Any]:
    """Return a prim's spec and those of all its variants."""
    found, open_ = [], [spec]
    while open_:
        each = open_.pop()
        found.append(each)
        open_ += [variant.primSpec for chosen in each.variantSets.values() for variant in chosen.variants.values()]
    return found


MOST_INSTANCES = 100_000
"""Largest number of instances of all PointInstancers of a stage"""
PLACED_BY = ("positions", "orientations", "scales", "velocities", "angularVelocities", "accelerations", "invisibleIds")
"""Attributes of a PointInstancer whose samples move its instances"""


class Scattered(NamedTuple):
    """Instances of a PointInstancer."""

    path: Sdf.Path
    prototypes: list[Sdf.Path]
    """Prototype of each instance"""
    matrices: list[tuple[Usd.TimeCode, Vt.Matrix4dArray]]
    """Places of all instances at each sample, or by default"""
    seen: list[tuple[Usd.TimeCode, NDArray[np.bool_]]]
    """Visibility of the instances at each sample, or by default"""
    children: list[str]
    """Names of the prims below, which are not shown themselves"""


def share_nothing(stage: Usd.Stage, is_changed: Callable[[Usd.Prim], bool]) -> None:
    """Give native instances that have such prims below them prims of their own, which can be changed."""
    every = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)
    while True:
        shared = [each for each in stage.GetPrototypes() if any(map(is_changed, Usd.PrimRange(each, every)))]
        with Sdf.ChangeBlock():
            for instance in (each for prototype in shared for each in prototype.GetInstances()):
                if not instance.IsInPrototype():
                    Sdf.CreatePrimInLayer(stage.GetSessionLayer(), instance.GetPath()).instanceable = False
        if not shared:
            return


def expand_instancers(stage: Usd.Stage, source: str) -> list[str]:
    """Put a prim in the place of each instance of the stage's PointInstancers, which become transforms around them.

    Returns:
        Sentences on PointInstancers that could not be taken.

    Raises:
        InputError: there are too many instances.
    """
    scattered, sentences, count = [], [], 0
    for prim in stage.TraverseAll():
        if instancer := UsdGeom.PointInstancer(prim):
            try:
                found = _scattered(instancer)
            except ValueError as error:
                sentences.append(f"Left out of the stage: {prim.GetPath()} (PointInstancer: {error}).")
                continue
            scattered.append(found)
            count += len(found.prototypes)
    if count > MOST_INSTANCES:
        raise InputError(f"{source}: its PointInstancers have {count:,} instances; expected at most {MOST_INSTANCES:,}")
    with Sdf.ChangeBlock():
        for each in scattered:
            _write(stage.GetSessionLayer(), each)
    return sentences


def _scattered(instancer: UsdGeom.PointInstancer) -> Scattered:
    """Read the instances of a PointInstancer.

    Raises:
        ValueError: its attributes do not fit together, or its instances come and go.
    """
    own, prim = instancer.GetProtoIndicesAttr(), instancer.GetPrim()
    if len({tuple(own.Get(time) or ()) for time in own.GetTimeSamples()}) > 1:
        raise ValueError("its protoIndices change")
    samples = {time for name in PLACED_BY for time in prim.GetAttribute(name).GetTimeSamples()}
    times = [Usd.TimeCode(time) for time in sorted(samples)]
    numbers = np.array(own.Get(Usd.TimeCode.EarliestTime()) or (), np.int64)
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    if ((numbers < 0) | (numbers >= len(targets))).any():
        raise ValueError(f"its protoIndices do not match its {len(targets)} prototypes")
    matrices, seen = [], []
    for time in times or [Usd.TimeCode.Default()]:
        placed = instancer.ComputeInstanceTransformsAtTime(
            time, time, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        )
        if len(placed) != len(numbers):
            raise ValueError(f"it places {len(placed)} instances of {len(numbers)}")
        mask = np.array(instancer.ComputeMaskAtTime(time) or np.ones(len(numbers)), bool)
        matrices.append((time, placed))
        seen.append((time, mask))
    children = [each.GetName() for each in prim.GetAllChildren()]
    return Scattered(prim.GetPath(), [targets[each] for each in numbers.tolist()], matrices, seen, children)


def _write(layer: Sdf.Layer, scattered: Scattered) -> None:
    around = Sdf.CreatePrimInLayer(layer, scattered.path)
    around.typeName = "Xform"
    for name in scattered.children:
        Sdf.CreatePrimInLayer(layer, scattered.path.AppendChild(name)).active = False
    hidden = ~np.array([mask for _, mask in scattered.seen])
    for number, prototype in enumerate(scattered.prototypes):
        if hidden[:, number].all():
            continue
        name = f"{prototype.name}_{number}"
        while name in scattered.children:
            name += "_"
        place = Sdf.PrimSpec(around, name, Sdf.SpecifierDef, "Xform")
        order = Sdf.AttributeSpec(place, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
        order.default = Vt.TokenArray(["xformOp:transform"])
        matrix = Sdf.AttributeSpec(place, "xformOp:transform", Sdf.ValueTypeNames.Matrix4d)
        for time, matrices in scattered.matrices:
            _set(layer, matrix, time, Gf.Matrix4d(matrices[number]))
        if hidden[:, number].any():
            visibility = Sdf.AttributeSpec(place, "visibility", Sdf.ValueTypeNames.Token)
            for time, mask in scattered.seen:
                _set(layer, visibility, time, "inherited" if mask[number] else "invisible")
        copy = Sdf.PrimSpec(place, prototype.name, Sdf.SpecifierDef)
        copy.active = True
        copy.referenceList.prependedItems = [Sdf.Reference("", prototype)]


def _set(layer: Sdf.Layer, attribute: Sdf.AttributeSpec, time: Usd.TimeCode, value: object) -> None:
    if time.IsDefault():
        attribute.default = value
    else:
        layer.SetTimeSample(attribute.path, time.GetValue(), value)


CELLS = 12
"""Number of quads along a quarter of a sphere"""
STRETCHED = 1e-4
"""Difference between the scales of a shape's axes from which on it is no sphere or capsule"""


def _sphere(radius: float) -> Faces:
    made = quad_sphere(CELLS, radius)
    return Faces(made.points, made.face_vertex_counts, made.face_vertex_indices)


class Kind(NamedTuple):
    """A kind of shape."""

    attributes: tuple[str, ...]
    make: Callable[..., Faces]
    """Function of the values of the attributes, and of the axis, if it has one"""


SHAPES = {
    "Cube": Kind(("size",), box_faces),
    "Sphere": Kind(("radius",), _sphere),
    "Plane": Kind(("width", "length", "axis"), rectangle_faces),
    "Cylinder": Kind(
        ("radius", "height", "axis"), lambda radius, height, axis: cylinder_faces((radius, radius), height, axis)
    ),
    "Cylinder_1": Kind(
        ("radiusTop", "radiusBottom", "height", "axis"), lambda top, low, *more: cylinder_faces((top, low), *more)
    ),
    "Cone": Kind(("radius", "height", "axis"), lambda radius, *more: cylinder_faces((0.0, radius), *more)),
    "Capsule": Kind(("radius", "height", "axis"), lambda radius, *more: capsule_faces((radius, radius), *more)),
    "Capsule_1": Kind(
        ("radiusTop", "radiusBottom", "height", "axis"), lambda top, low, *more: capsule_faces((top, low), *more)
    ),
}
"""Shapes by their type's name in USD"""
ROUND = ("Sphere", "Capsule")
"""Shapes that pictures and checks take as they are, not as meshes"""


def as_meshes(stage: Usd.Stage, source: str, *, rounds: bool) -> list[str]:
    """Turn all shapes of a stage into meshes, and each instance of a PointInstancer into a prim, in memory.

    Args:
        stage: its session layer takes the changes.
        source: name of the file.
        rounds: whether spheres and capsules become meshes, too; otherwise only those stretched along an axis do.

    Returns:
        Sentences on PointInstancers that could not be taken.

    Raises:
        InputError: there are too many instances, or a size is not finite.
    """
    kinds = SHAPES if rounds else {name: kind for name, kind in SHAPES.items() if name not in ROUND}
    share_nothing(stage, lambda prim: prim.GetTypeName() in kinds or bool(UsdGeom.PointInstancer(prim)))
    _turn(stage, source, [prim for prim in stage.TraverseAll() if prim.GetTypeName() in kinds])
    sentences = expand_instancers(stage, source)
    if not rounds:
        _turn(
            stage, source, [prim for prim in stage.TraverseAll() if prim.GetTypeName() in ROUND and _is_stretched(prim)]
        )
    return sentences


def others_than(prims: Iterable[Usd.Prim], kinds: tuple[type[UsdGeom.Imageable], ...]) -> list[str]:
    """Return the path and the type of each prim that has a shape of another kind than these."""
    return [
        f"{prim.GetPath()} ({prim.GetTypeName()})"
        for prim in prims
        if (UsdGeom.Gprim(prim) or prim.GetTypeName() == "Volume") and not any(kind(prim) for kind in kinds)
    ]


def _turn(stage: Usd.Stage, source: str, prims: list[Usd.Prim]) -> None:
    """Turn prims into meshes.

    Raises:
        InputError: a size is not finite.
    """
    made = [(prim.GetPath(), _shapes(prim, source)) for prim in prims]
    layer = stage.GetSessionLayer()
    with Sdf.ChangeBlock():
        for path, shapes in made:
            spec = Sdf.CreatePrimInLayer(layer, path)
            spec.typeName = "Mesh"
            points = Sdf.AttributeSpec(spec, "points", Sdf.ValueTypeNames.Point3fArray)
            for time, faces in shapes:
                placed = Vt.Vec3fArray.FromNumpy(faces.points.astype(np.float32))
                if time.IsDefault():
                    points.default = placed
                else:
                    layer.SetTimeSample(points.path, time.GetValue(), placed)
            faces = shapes[0][1]
            of_ints, of_token = Sdf.ValueTypeNames.IntArray, Sdf.ValueTypeNames.Token
            Sdf.AttributeSpec(spec, "faceVertexCounts", of_ints).default = Vt.IntArray.FromNumpy(faces.counts)
            Sdf.AttributeSpec(spec, "faceVertexIndices", of_ints).default = Vt.IntArray.FromNumpy(faces.indices)
            for name, said in (("subdivisionScheme", "none"), ("orientation", "rightHanded")):
                Sdf.AttributeSpec(spec, name, of_token, Sdf.VariabilityUniform).default = said


def _shapes(prim: Usd.Prim, source: str) -> list[tuple[Usd.TimeCode, Faces]]:
    """Return the shape of a prim at each sample of its sizes, or by default."""
    kind = SHAPES[prim.GetTypeName()]
    attributes = [prim.GetAttribute(name) for name in kind.attributes]
    samples = sorted({time for each in attributes for time in each.GetTimeSamples()})
    times = [Usd.TimeCode(time) for time in samples] or [Usd.TimeCode.Default()]
    return [(time, kind.make(*(_number(each, time, source) for each in attributes))) for time in times]


def _number(attribute: Usd.Attribute, time: Usd.TimeCode, source: str) -> Any:
    """Return a size, or the number of an axis."""
    value = attribute.Get(time)
    if isinstance(value, str):
        return "XYZ".index(value)
    if not 0.0 <= value < np.inf:
        raise InputError(f"{source}: {attribute.GetPath()} is {value:g}; expected a finite size of 0 or more")
    return value


def _is_stretched(prim: Usd.Prim) -> bool:
    """Return whether a prim's axes have several scales, or are not at right angles, where it is first."""
    matrix = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.EarliestTime())
    turned = np.array(matrix)[:3, :3]
    square = turned @ turned.T
    size = np.trace(square) / 3.0
    return bool(np.abs(square - size * np.eye(3)).max() > 2.0 * STRETCHED * size)


MOST_NAMED = 5
"""Largest number of things that a sentence names"""


class Opened(NamedTuple):
    """An open stage."""

    stage: Usd.Stage
    warnings: tuple[str, ...]
    """Sentences on USD's errors, such as missing files, and on instances that could not be taken"""


def open_stage(path: Path | str) -> Usd.Stage:
    """Return the stage of a file, as it is.

    Raises:
        InputError: it is none, or asks for too much.
    """
    if legible(str(path)) != str(path):
        raise InputError(f"{legible(str(path))}: the name is not UTF-8, which USD requires; expected another name")
    _quiet = UsdUtils.CoalescingDiagnosticDelegate()  # while it lives, USD prints nothing
    behind = file_behind(Path(path))
    limits = Limits(behind)
    try:
        stage = Usd.Stage.Open(str(behind))
    except Tf.ErrorException as error:
        raise InputError(f"{path}: cannot be read as a USD stage; expected one, such as `run` writes") from error
    del limits  # which kept the layers until USD had them
    return stage


def open_meshes(path: Path | str, *, rounds: bool = True) -> Opened:
    """Return the stage of a file in which shapes are meshes and instances are prims, as `as_meshes` makes them.

    Raises:
        InputError: it is none, or has too many instances.
    """
    stage = open_stage(path)
    untyped: Any = stage  # USD's types lack the method
    errors: list[object] = untyped.GetCompositionErrors()
    missing = _first([str(error).partition("\n")[0] for error in errors])
    _quiet = UsdUtils.CoalescingDiagnosticDelegate()
    return Opened(stage, (*missing, *as_meshes(stage, str(path), rounds=rounds)))


def _first(errors: list[str]) -> list[str]:
    """Return the first errors of a stage, as USD says them, a sentence each, and how many more there are."""
    more = [f"USD: {len(errors) - MOST_NAMED} more such errors."] if len(errors) > MOST_NAMED else []
    return [*(f"USD: {each}" for each in errors[:MOST_NAMED]), *more]


def listed(names: Sequence[str]) -> str:
    """Return the first few names, and how many more there are."""
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
