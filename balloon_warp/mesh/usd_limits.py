"""Limits of a USD stage, checked before USD reads and composes it: it does neither with a bound.

A stage is refused whose files wait or have no end, are nested deeper than USD's parser stands, or whose references
multiply, run in a circle, or follow each other for long.
"""

import re
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Sdf, Tf

from balloon_warp.errors import InputError
from balloon_warp.files import check_regular

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
