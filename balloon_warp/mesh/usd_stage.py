"""Meshes of USD stages at the default time: their rigid motion, materials, colors and textures.

By time samples of their transforms and of those around them, or by samples of their points, skins and blend shapes.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Gf, Usd, UsdGeom, UsdShade, UsdSkel

from balloon_warp.errors import InputError, did_you_mean
from balloon_warp.mesh.crossings import Pictures, check_mesh
from balloon_warp.mesh.polygon_mesh import Color, Look, Looks, Picture, PolygonMesh, looks_of, together
from balloon_warp.mesh.topology import backward_corners, with_corners
from balloon_warp.mesh.usd_open import listed, open_meshes, others_than


def bound_surface(prim: Usd.Prim) -> UsdShade.Shader | None:
    """Return the UsdPreviewSurface of a prim's material."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    shader = material.ComputeSurfaceSource()[0] if material else None
    return shader if shader and shader.GetIdAttr().Get() == "UsdPreviewSurface" else None


def constant_of(surface: UsdShade.Shader, name: str) -> Any:
    """Return the value of an input, through connections to the material's own inputs; None where a texture feeds it."""
    shader_input = surface.GetInput(name)
    for attribute in shader_input.GetValueProducingAttributes() if shader_input else []:
        if UsdShade.Utils.GetType(attribute.GetName()) != UsdShade.AttributeType.Output:
            return attribute.Get()
    return None


def owners_of_faces(prim: Usd.Prim, face_count: int) -> tuple[list[Usd.Prim], NDArray[np.int32]]:
    """Return the prims with the looks of faces, and the number of each face's prim, shape (face_count,).

    They are the mesh and then its subsets that have a material.
    """
    owners, numbers = [prim], np.zeros(face_count, np.int32)
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets() if UsdGeom.Mesh(prim) else []:
        faces = np.asarray(subset.GetIndicesAttr().Get() or (), np.int64)
        numbers[faces[(faces >= 0) & (faces < face_count)]] = len(owners)
        owners.append(subset.GetPrim())
    return owners, numbers


class Image(NamedTuple):
    """A texture that gives a surface its color."""

    named: str
    """Path as the stage names it"""
    path: str
    """Path as USD resolves it; empty where it is missing"""
    raw: bool
    """Whether its numbers are linear light"""
    scale: tuple[float, float, float]
    """Factor on its numbers"""
    coordinates: str
    """Primvar with the texture coordinates"""
    transform: NDArray[np.float64]
    """Transform of texture coordinates: rows of a matrix, shape (2, 3)"""


def image_of(surface: UsdShade.Shader | None) -> Image | None:
    """Return the texture that feeds a surface's color, if one does."""
    texture = _feeding(surface, "diffuseColor", "UsdUVTexture")
    file = constant_of(texture, "file") if texture else None
    if texture is None or not file or not file.path:
        return None
    transform, reader = np.eye(3)[:2], _feeding(texture, "st", "UsdPrimvarReader_float2")
    if placed := _feeding(texture, "st", "UsdTransform2d"):
        reader, transform = _feeding(placed, "in", "UsdPrimvarReader_float2"), _transform(placed)
    name = constant_of(reader, "varname") if reader else None
    scale = constant_of(texture, "scale")
    red, green, blue, _ = np.array(Gf.Vec4f(1.0) if scale is None else scale, np.float64).tolist()
    raw = constant_of(texture, "sourceColorSpace") == "raw"
    return Image(file.path, file.resolvedPath, raw, (red, green, blue), str(name or "st"), transform)


def missing_image(prim: Usd.Prim) -> str:
    """Return the file that a texture's prim names if it is not there, else nothing."""
    shader = UsdShade.Shader(prim)
    file = constant_of(shader, "file") if shader and shader.GetIdAttr().Get() == "UsdUVTexture" else None
    return file.path if file and not file.resolvedPath else ""


def content_of(path: str) -> bytes | None:
    """Return the content of a file that USD has resolved, such as one in a package; None if it cannot be read."""
    resolver: Any = Ar.GetResolver()
    try:
        return bytes(resolver.OpenAsset(Ar.ResolvedPath(path)).GetBuffer())
    except AttributeError:  # USD hands out nothing
        return None


def places_of(mesh: UsdGeom.Mesh, image: Image, indices: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """Return the place of each corner in an image, from 0 to 1 to the right and up, shape (corner_count, 2).

    The mesh's only texture coordinates count under any name. None where it does not say it.
    """
    places = texture_coordinates(mesh, image.coordinates, indices)
    if places is None:
        named = [each.GetPrimvarName() for each in UsdGeom.PrimvarsAPI(mesh).FindPrimvarsWithInheritance()]
        others = [other for name in named if (other := texture_coordinates(mesh, name, indices)) is not None]
        places = others[0] if len(others) == 1 else None
    if places is None or np.array_equal(image.transform, np.eye(3)[:2]):
        return places
    whole = np.column_stack([places, np.ones(len(places))])
    return (whole @ image.transform.T).astype(np.float32)


def texture_coordinates(mesh: UsdGeom.Mesh, name: str, indices: NDArray[np.int32]) -> NDArray[np.float32] | None:
    """Return the texture coordinates of a name at each corner, shape (corner_count, 2).

    None without them, or where they do not fit the mesh.
    """
    primvar = UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(name)
    authored: Any = primvar.ComputeFlattened() if primvar and primvar.HasValue() else None
    places = np.asarray([] if authored is None else authored, np.float32)
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        return None
    if primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying:
        return places if len(places) == len(indices) else None
    of_points = primvar.GetInterpolation() in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)
    return places[indices] if of_points and len(places) > indices.max(initial=-1) else None


def display_colors(gprim: UsdGeom.Gprim) -> tuple[NDArray[np.float32], str]:
    """Return display colors, shape (n, 3), and their interpolation."""
    display = UsdGeom.PrimvarsAPI(gprim).FindPrimvarWithInheritance("displayColor")
    authored: Any = display.ComputeFlattened() if display else None
    colors = np.asarray([] if authored is None else authored, np.float32).reshape(-1, 3)
    return colors, display.GetInterpolation() if display else UsdGeom.Tokens.constant


def at_corners(
    colors: NDArray[np.float32],
    interpolation: str,
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    point_count: int,
) -> NDArray[np.float32] | None:
    """Display colors at each corner of a mesh's faces, shape (len(indices), 3); None where they are one color, or none.

    They are laid out as their interpolation says; where their number is another's, as that one has it.
    """
    places = {
        UsdGeom.Tokens.faceVarying: (len(indices), np.arange(len(indices))),
        UsdGeom.Tokens.vertex: (point_count, indices),
        UsdGeom.Tokens.varying: (point_count, indices),
        UsdGeom.Tokens.uniform: (len(counts), np.repeat(np.arange(len(counts)), counts)),
    }
    if len(colors) > 1:
        for name in (interpolation, *places):
            if name in places and places[name][0] == len(colors):
                return colors[places[name][1]]
    return None


def _feeding(shader: UsdShade.Shader | None, name: str, kind: str) -> UsdShade.Shader | None:
    """Return the shader of a kind that an input is connected to."""
    given = shader.GetInput(name) if shader else None
    for attribute in given.GetValueProducingAttributes() if given else []:
        source = UsdShade.Shader(attribute.GetPrim())
        if source and source.GetIdAttr().Get() == kind:
            return source
    return None


def _transform(shader: UsdShade.Shader) -> NDArray[np.float64]:
    """Return the matrix of a UsdTransform2d: scaled, then turned, then moved."""
    scale, turn, move = (constant_of(shader, name) for name in ("scale", "rotation", "translation"))
    wide, high = (1.0, 1.0) if scale is None else scale
    x, y = (0.0, 0.0) if move is None else move
    angle = np.radians(turn or 0.0)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * wide, -s * high, x], [s * wide, c * high, y]])


class Seen(NamedTuple):
    """Looks and texture coordinates that were read of a mesh."""

    texture_coordinates: NDArray[np.float32] | None
    looks: Looks | None


def read_looks(
    geometry: UsdGeom.Mesh, counts: NDArray[np.int32], indices: NDArray[np.int32], pictures: Pictures
) -> Seen:
    """Read the looks of a mesh from the materials bound to it and to its subsets, else from its display colors."""
    prim = geometry.GetPrim()
    owners, of_faces = owners_of_faces(prim, len(counts))
    of_corners = np.repeat(of_faces, counts)
    places = texture_coordinates(geometry, "st", indices)
    looks: list[Look | None] = []
    for number, owner in enumerate(owners):
        surface = bound_surface(owner)
        image = image_of(surface)
        here = of_corners == number
        own = places_of(geometry, image, indices) if image else None
        picture = _read(image, pictures) if image and here.any() else None
        name = surface.GetPrim().GetParent().GetName() if surface else owner.GetName()
        if image and picture:
            access = Look(name, image.scale, picture)
            if own is None:
                access = pictures.mean_of(access, f"{image.named} of {prim.GetPath()}")
            else:
                places = np.zeros((len(indices), 2), np.float32) if places is None else places
                places = np.where(here[:, None], own, places)
            looks.append(access)
        else:
            color = constant_of(surface, "diffuseColor") if surface and _is_said(surface) else None
            looks.append(None if color is None else Look(name, _color(color)))
    return Seen(places, _with_display_colors(geometry, looks, counts, indices, of_corners))


def _with_display_colors(
    geometry: UsdGeom.Mesh,
    looks: list[Look | None],
    counts: NDArray[np.int32],
    indices: NDArray[np.int32],
    of_corners: NDArray[np.int32],
) -> Looks | None:
    """Add display colors where no material says a color."""
    silent = np.array([access is None for access in looks])[of_corners]
    colors, interpolation = display_colors(geometry)
    if not silent.any() or not len(colors) or not np.isfinite(colors).all():
        return looks_of(looks, of_corners)
    points: Any = geometry.GetPointsAttr().Get() or geometry.GetPointsAttr().Get(Usd.TimeCode.EarliestTime())
    shades = at_corners(colors, interpolation, counts, indices, len(points))
    if shades is None:
        one = Look("displayColor", _color(colors.mean(axis=0)))
        return looks_of([*looks, one], np.where(silent, len(looks), of_corners))
    materials = looks_of(looks, of_corners)
    said = Looks((), np.full(len(indices), -1, np.int32)) if materials is None else materials
    return Looks(said.materials, said.of_corners, shades)


def _is_said(surface: Any) -> bool:
    given = surface.GetInput("diffuseColor")
    return bool(given) and (given.GetAttr().HasAuthoredValue() or given.HasConnectedSource())


def _color(value: Any) -> Color:
    red, green, blue = np.clip(np.asarray(value, np.float64), 0.0, 1.0).tolist()
    return red, green, blue


def _read(image: Image, pictures: Pictures) -> Picture | None:
    """Read an image from the package that it is in, or from its file."""
    if not image.path:
        return pictures.of_bytes(image.named, None)
    return pictures.of_bytes(image.named, content_of(image.path) or b"", Path(image.path))


SCENERY = "balloonWarpScenery"
"""Key of the custom data of meshes in our own stages that are scenery, such as the ground"""


def read_stage(path: Path | str, prim: str | Sequence[str] | None) -> PolygonMesh:
    """See `read_usd`."""
    stage, warnings = open_meshes(path)
    chosen = choose_prims(stage, path, prim)
    pictures = Pictures(path)
    parts = [_read_prim(stage, each, f"{path}: {each.GetPath()}", pictures) for each in chosen.prims]
    mesh = parts[0] if len(parts) == 1 else _together(chosen.prims, parts, _name(prim, path))
    return replace(mesh, warnings=(*warnings, *chosen.warnings, *pictures.warnings))


class Chosen(NamedTuple):
    """Meshes chosen from a stage."""

    prims: list[Usd.Prim]
    """Prims of the meshes, in the stage's order"""
    warnings: tuple[str, ...]
    """Warnings: a sentence that names the meshes which were left out"""


def choose_prims(stage: Usd.Stage, path: Path | str, prim: str | Sequence[str] | None) -> Chosen:
    """Choose the meshes of a stage: those at or below the named prims, or all that are shown.

    Meshes are shown if they are visible and have the purpose "default" or "render".

    Raises:
        InputError: there is none, or no such prim.
    """
    everything = list(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
    meshes = [each for each in everything if UsdGeom.Mesh(each)]
    taken = everything if prim is None else [each for name in _names(prim) for each in _below(everything, name)]
    others = others_than((each for each in taken if not _why_hidden(each)), (UsdGeom.Mesh,))
    if not meshes:
        found = f", but {listed(others)}" if others else ""
        raise InputError(f"{path}: has no mesh and no solid shape{found}; expected a prim such as a Mesh or a Sphere")
    if prim is not None:
        prims = [each for name in _names(prim) for each in _meshes_below(meshes, path, name)]
        taken = [each for each in meshes if each in prims]
        return Chosen(taken, (*([f"Left out of the stage: {listed(others)}."] if others else []), *_blinking(taken)))
    hidden = {str(each.GetPath()): _why_hidden(each) for each in meshes}
    shown = [each for each in meshes if not hidden[str(each.GetPath())]]
    left_out = listed([*others, *(f"{name} ({why})" for name, why in hidden.items() if why)])
    if not shown:
        raise InputError(f'{path}: has no visible mesh: {left_out}; prim = "{meshes[0].GetPath()}" selects it anyway')
    said = [f"Left out of the stage: {left_out}; prim selects other meshes."] if left_out else []
    return Chosen(shown, (*said, *_blinking(shown)))


def _blinking(prims: list[Usd.Prim]) -> list[str]:
    """Return a sentence on the meshes that are taken for always, though they appear or disappear."""
    found = [str(each.GetPath()) for each in prims if _appears_or_goes(each)]
    return [f"The visibility of {listed(found)} changes over time, which is not followed."] if found else []


def _names(prim: str | Sequence[str]) -> Sequence[str]:
    return [prim] if isinstance(prim, str) else prim


def _below(prims: list[Usd.Prim], name: str) -> list[Usd.Prim]:
    """Return the prims at or below a path, or at or below prims of a name."""
    words = f"/{name.strip('/')}/"
    paths = [(f"{each.GetPath()}/", each) for each in prims]
    return [each for path, each in paths if path.startswith(words) or (name[:1] != "/" and words in path)]


def _meshes_below(meshes: list[Usd.Prim], path: Path | str, name: str) -> list[Usd.Prim]:
    """Return the mesh at a path, whether it is shown or not; or those below it that are shown.

    Raises:
        InputError: there is none.
    """
    below = _below(meshes, name)
    exact = [each for each in below if str(each.GetPath()) == name]
    if found := exact or [each for each in below if not _why_hidden(each)] or below:
        return found
    paths = [str(each.GetPath()) for each in meshes]
    raise InputError(f"{path}: has no mesh at or below prim {name} (it has {listed(paths)}){did_you_mean(name, paths)}")


def _why_hidden(prim: Usd.Prim) -> str:
    """Return why a mesh is not shown, "" if it is."""
    if prim.HasCustomDataKey(SCENERY):
        return "scenery"
    imageable = UsdGeom.Imageable(prim)
    if imageable.ComputeVisibility(Usd.TimeCode.EarliestTime()) == UsdGeom.Tokens.invisible:
        return "invisible at first" if _appears_or_goes(prim) else "invisible"
    purpose = imageable.ComputePurpose()
    return "" if purpose in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render) else f"purpose {purpose}"


def _appears_or_goes(prim: Usd.Prim) -> bool:
    """Return whether the visibility of a prim, or of one that it stands in, has several values over time."""
    while prim:
        seen = UsdGeom.Imageable(prim).GetVisibilityAttr() if UsdGeom.Imageable(prim) else None
        if seen and len({seen.Get(time) for time in seen.GetTimeSamples()}) > 1:
            return True
        prim = prim.GetParent()
    return False


def _name(prim: str | Sequence[str] | None, path: Path | str) -> str:
    """Return a name for several meshes together."""
    return prim.rstrip("/").rpartition("/")[2] or Path(path).stem if isinstance(prim, str) else Path(path).stem


def _together(prims: list[Usd.Prim], parts: list[PolygonMesh], name: str) -> PolygonMesh:
    """Return meshes as one, each a group by the name of its prim, or by its path where the name is not unique."""
    first = np.cumsum([0, *(part.vertex_count for part in parts)])[:-1]
    counts = Counter(part.name for part in parts)
    groups: dict[str, NDArray[np.int32]] = {}
    for begin, prim, part in zip(first.tolist(), prims, parts, strict=True):
        own = part.name if counts[part.name] == 1 else str(prim.GetPath())
        every = np.arange(part.vertex_count, dtype=np.int32)
        for group, vertices in {own: every, **part.groups}.items():
            groups[group] = np.union1d(groups.get(group, every[:0]), vertices + np.int32(begin)).astype(np.int32)
    return replace(
        parts[0],
        points=np.concatenate([part.points for part in parts]),
        face_vertex_counts=np.concatenate([part.face_vertex_counts for part in parts]),
        face_vertex_indices=np.concatenate(
            [part.face_vertex_indices + np.int32(begin) for begin, part in zip(first.tolist(), parts, strict=True)]
        ),
        name=name,
        groups=groups,
        **together(parts),
    )


def _read_prim(stage: Usd.Stage, prim: Usd.Prim, source: str, pictures: Pictures) -> PolygonMesh:
    geometry = UsdGeom.Mesh(prim)
    points = points_of(geometry, source)
    counts = np.array(_value(geometry.GetFaceVertexCountsAttr(), source), dtype=np.int32)
    indices = np.array(_value(geometry.GetFaceVertexIndicesAttr(), source), dtype=np.int32)
    unit = UsdGeom.GetStageMetersPerUnit(stage)
    if not 0.0 < unit < np.inf:
        raise InputError(f"{source}: the stage's metersPerUnit must be positive (got {unit})")

    to_world = world_matrix(prim)
    left_handed = geometry.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    mesh = PolygonMesh(
        # USD multiplies row vectors from the left.
        points=points @ to_world[:3, :3] + to_world[3, :3],
        face_vertex_counts=counts,
        face_vertex_indices=indices,
        name=prim.GetName(),
        up_axis=str(UsdGeom.GetStageUpAxis(stage)),
        up_known=bool(stage.GetRootLayer().pseudoRoot.HasInfo("upAxis")),
        meters_per_unit=float(unit),
        unit_known=UsdGeom.StageHasAuthoredMetersPerUnit(stage),
    )
    check_mesh(mesh, source)
    places, looks = read_looks(geometry, counts, indices, pictures)
    mesh = replace(
        mesh,
        texture_coordinates=places,
        looks=looks,
        groups=_groups(geometry, counts, indices, len(points)),
    )
    if left_handed != (np.linalg.det(to_world[:3, :3]) < 0.0):
        mesh = with_corners(mesh, backward_corners(mesh))
    return mesh


def _groups(
    geometry: UsdGeom.Mesh, counts: NDArray[np.int32], indices: NDArray[np.int32], point_count: int
) -> dict[str, NDArray[np.int32]]:
    """Return the points of the mesh's subsets, of faces or of points, ascending, without indices out of range."""
    groups, faces = {}, np.repeat(np.arange(len(counts)), counts)
    for subset in UsdGeom.Subset.GetAllGeomSubsets(geometry):
        named = np.array(subset.GetIndicesAttr().Get() or (), dtype=np.int32)
        if subset.GetElementTypeAttr().Get() == UsdGeom.Tokens.face:
            groups[subset.GetPrim().GetName()] = np.unique(indices[np.isin(faces, named)])
        elif subset.GetElementTypeAttr().Get() == UsdGeom.Tokens.point:
            groups[subset.GetPrim().GetName()] = np.unique(named[(named >= 0) & (named < point_count)])
    return groups


def points_of(geometry: UsdGeom.Mesh, source: str) -> NDArray[np.float64]:
    """Return a mesh's own points, at the default time or their earliest sample, shape (n, 3).

    Raises:
        InputError: it has none.
    """
    return np.array(_value(geometry.GetPointsAttr(), source), dtype=np.float64).reshape(-1, 3)


def _value(attribute: Usd.Attribute, source: str) -> Any:
    value = attribute.Get()
    if value is None:
        value = attribute.Get(Usd.TimeCode.EarliestTime())
    if value is None:
        raise InputError(f"{source}: has no {attribute.GetName()}")
    return value


def world_matrix(prim: Usd.Prim) -> NDArray[np.float64]:
    """Return the local-to-world matrix, shape (4, 4), for row vectors.

    A transform without default is taken at its earliest sample.
    """
    time = Usd.TimeCode.Default()
    ancestor = prim
    while ancestor:
        for operation in UsdGeom.Xformable(ancestor).GetOrderedXformOps():
            if operation.GetAttr().Get() is None:
                time = Usd.TimeCode.EarliestTime()
        ancestor = ancestor.GetParent()
    return np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time))


MOST_SCALED = 1e-3
"""Largest growth or bending of a rigid thing, over its size"""


@dataclass(frozen=True)
class StageMotion:
    """Meshes of a stage that move as one."""

    path: Path
    stage: Usd.Stage
    """Stage, which a prim does not keep alive"""
    prims: list[Usd.Prim]
    """Prims of the meshes"""
    begin: float
    """Time code at which the stage begins"""
    codes_per_second: float
    seconds: float
    """Duration to the last sample [s]; 0 if nothing moves"""

    def matrices(self, times: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the transforms of the meshes' points at times since the stage's beginning [s], shape (n, 4, 4).

        They take points as they are read to their places then, in the stage's unit and axes, for column vectors.

        Raises:
            InputError: they do not keep their size or shape.
        """
        prim = self.prims[0]
        still = np.linalg.inv(world_matrix(prim))
        codes = [Usd.TimeCode(code) for code in (self.begin + np.asarray(times) * self.codes_per_second).tolist()]
        moved = [still @ np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(code)) for code in codes]
        if samples_of_points(prim):
            local = [_rigid(self.path, prim, code) for code in codes]
            placed = world_matrix(prim)
            moved = [np.linalg.inv(placed) @ own @ placed @ move for own, move in zip(local, moved, strict=True)]
        columns = np.swapaxes(np.array(moved).reshape(-1, 4, 4), 1, 2)
        turned = columns[:, :3, :3]
        if np.abs(turned @ np.swapaxes(turned, 1, 2) - np.eye(3)).max(initial=0.0) > MOST_SCALED:
            raise InputError(f"{self.path}: {prim.GetPath()} changes its size while moving; expected a rigid obstacle")
        return np.asarray(columns, dtype=np.float64)


def read_motions(path: Path, prim: str | Sequence[str] | None) -> list[StageMotion]:
    """Return the meshes that are taken of a stage, grouped by those that move together; those that stay come first.

    Raises:
        InputError: as `read_usd`, or the stage's time does not run.
    """
    stage = open_meshes(path).stage
    rate = stage.GetTimeCodesPerSecond()
    if not 0.0 < rate < np.inf:
        raise InputError(f"{path}: its timeCodesPerSecond is {rate:g}; expected a rate above 0")
    prims = choose_prims(stage, path, prim).prims
    _bake_skins(stage, prims)
    groups: dict[tuple[str, ...], list[Usd.Prim]] = {}
    for each in prims:
        groups.setdefault(tuple(_movers(each)), []).append(each)
    motions = []
    for movers in sorted(groups, key=lambda each: each != ()):
        samples = [time for each in groups[movers][:1] for time in _samples(each)]
        begin, end = min(samples, default=0.0), max(samples, default=0.0)
        if stage.HasAuthoredTimeCodeRange() and stage.GetStartTimeCode() <= end:
            begin, end = stage.GetStartTimeCode(), max(min(end, stage.GetEndTimeCode()), stage.GetStartTimeCode())
        seconds = (end - begin) / rate if movers else 0.0
        motions.append(StageMotion(path, stage, groups[movers], begin, rate, seconds))
    return motions


def samples_of_points(prim: Usd.Prim) -> list[float]:
    """Return the time codes at which a mesh has points, where it has several."""
    times = UsdGeom.Mesh(prim).GetPointsAttr().GetTimeSamples()
    return times if len(times) > 1 else []


def _around(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Return a prim and the prims that it stands in."""
    while prim:
        yield prim
        prim = prim.GetParent()


def _movers(prim: Usd.Prim) -> Iterator[str]:
    """Return the prims by whose samples a mesh moves: of itself and of the prims that it stands in."""
    for each in _around(prim):
        if len(_samples_of_transforms(each)) > 1 or (each == prim and samples_of_points(prim)):
            yield str(each.GetPath())


def _samples(prim: Usd.Prim) -> set[float]:
    return set(samples_of_points(prim)).union(*(_samples_of_transforms(each) for each in _around(prim)))


def _samples_of_transforms(prim: Usd.Prim) -> set[float]:
    operations = UsdGeom.Xformable(prim).GetOrderedXformOps()
    return {time for operation in operations for time in operation.GetTimeSamples()}


def _bake_skins(stage: Usd.Stage, prims: Sequence[Usd.Prim]) -> None:
    """Turn skins and blend shapes into samples of points, in memory, where a mesh has any."""
    if any("SkelBindingAPI" in each.GetAppliedSchemas() for prim in prims for each in _around(prim)):
        with Usd.EditContext(stage, stage.GetSessionLayer()):
            UsdSkel.BakeSkinning(stage.Traverse(), Gf.Interval.GetFullInterval())


def _rigid(path: Path, prim: Usd.Prim, code: Usd.TimeCode) -> NDArray[np.float64]:
    """Return the rigid transform of a mesh's own points to their places at a time (Kabsch 1976).

    Shape (4, 4), for row vectors.

    Raises:
        InputError: they do more than turn and shift.
    """
    before = points_of(UsdGeom.Mesh(prim), str(path))
    after = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get(code), dtype=np.float64).reshape(-1, 3)
    size = float(np.ptp(before, axis=0).max())
    if len(after) == len(before):
        centers = before.mean(axis=0), after.mean(axis=0)
        left, _, right = np.linalg.svd((before - centers[0]).T @ (after - centers[1]))
        turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
        if np.abs((before - centers[0]) @ turn + centers[1] - after).max() <= MOST_SCALED * size:
            matrix = np.eye(4)
            matrix[:3, :3], matrix[3, :3] = turn, centers[1] - centers[0] @ turn
            return matrix
    raise InputError(f"{path}: {prim.GetPath()} deforms by its points, skin or blend shapes; expected a rigid obstacle")
