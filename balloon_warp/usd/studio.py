"""The studio: lights, a backdrop, and a camera that has the run in view; the stage at one point in time.

Lights, a backdrop, and a camera that has the run in view, in a group of their own that can be left out or deleted.

They stand around the subject as the camera sees it, and so are defined once the run is over.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt

from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import vertex_normals
from balloon_warp.mesh.usd_stage import SCENERY
from balloon_warp.scene import Scene
from balloon_warp.scene.around import paper_of
from balloon_warp.usd.material import BACKDROP, Color, emission_input, paint, take_from_primvar

Z_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation of row vectors with Z up into ones with Y up"""


class Moment:
    """Moment of a stage: places of prims at a time code, Y up, in the stage's unit."""

    def __init__(self, stage: Usd.Stage, time: float):
        self.time = Usd.TimeCode(time)
        self._xforms = UsdGeom.XformCache(self.time)
        self._turn = Z_TO_Y_UP if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else np.eye(3)

    def place(self, prim: Usd.Prim, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return a prim's points in the world, shape (n, 3)."""
        matrix = self._matrix(prim)
        return (points.astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]) @ self._turn

    def scale(self, prim: Usd.Prim) -> float:
        """Return the factor on lengths from the prim to the world: the cube root of the change in volume."""
        return float(np.cbrt(abs(np.linalg.det(self._matrix(prim)[:3, :3]))))

    def is_frame(self, matrix: Gf.Matrix4d) -> bool:
        """Return whether a matrix is finite and its x, y and z axes span space."""
        rows = np.array(matrix)
        lengths = np.linalg.norm(rows[:3, :3], axis=1)
        if not (np.isfinite(rows).all() and lengths.all()):
            return False
        return bool(abs(np.linalg.det(rows[:3, :3] / lengths[:, None])) > 1e-6)

    def axes(self, matrix: Gf.Matrix4d) -> NDArray[np.float64]:
        """Return the unit vectors along the x, y and z axes of a frame, a row each, shape (3, 3)."""
        rows = np.array(matrix)[:3, :3]
        return rows / np.linalg.norm(rows, axis=1, keepdims=True) @ self._turn

    def origin(self, matrix: Gf.Matrix4d) -> NDArray[np.float64]:
        """Return the position of a frame's origin, shape (3,)."""
        return np.array(matrix)[3, :3] @ self._turn

    def _matrix(self, prim: Usd.Prim) -> NDArray[np.float64]:
        return np.array(self._xforms.GetLocalToWorldTransform(prim))


VERTICAL_VIEW = np.radians(26.0)
"""Vertical angle of view, as of a portrait lens"""
AZIMUTH = 32.0
"""Azimuth of a three-quarter view, from the front (+Z) toward +X [degrees]"""
ELEVATION = 13.0
"""Elevation above the horizon [degrees]"""
KEY_AZIMUTH = -45.0
"""Azimuth of the main light from the camera toward its right [degrees]: over the photographer's left shoulder"""
MARGIN = 0.80
"""Fraction of the picture's half size within which the action stays"""


@dataclass(frozen=True)
class Camera:
    """Camera of a picture, Y up, in the stage's unit."""

    eye: NDArray[np.float64]
    """Position, shape (3,)"""
    axes: NDArray[np.float64]
    """Unit vectors to the right, up and backward, a row each, shape (3, 3)"""
    half_width: float
    """Half the picture's width at distance one"""
    half_height: float
    """Half the picture's height at distance one"""
    aperture: float = 0.0
    """Diameter of the lens; 0 for a pinhole"""
    focus: float = 1.0
    """Distance in focus"""

    def pixel_size(self, place: NDArray[np.float64], height: int) -> float:
        """Return the size of a pixel at a place, in a picture `height` pixels high."""
        distance = float(abs((self.eye - place) @ self.axes[2]))
        return 2.0 * self.half_height * distance / height

    @property
    def level_axes(self) -> NDArray[np.float64]:
        """Unit vectors to the right, up, and level back toward the camera, a row each, shape (3, 3)."""
        right, _, backward = self.axes
        across = np.array([right[0], 0.0, right[2]])
        across /= np.linalg.norm(across)
        level = np.cross(across, [0.0, 1.0, 0.0])
        return np.stack([across, [0.0, 1.0, 0.0], level if level @ backward >= 0.0 else -level])

    def looking_at(self, middle: NDArray[np.float64], center: NDArray[np.float64]) -> "Camera":
        """Return the camera moved aside, at its distance from `center`, so that `middle` is in the picture's middle."""
        distance = float((self.eye - center) @ self.axes[2])
        return replace(self, eye=middle + distance * self.axes[2])

    def zoomed(self, zoom: float) -> "Camera":
        """Return the camera with a lens that shows everything `zoom` times as large."""
        return replace(self, half_width=self.half_width / zoom, half_height=self.half_height / zoom)


class CameraFit:
    """Finds the camera nearest to the action that still has it all in the picture, for a fixed direction of view.

    A sphere of radius r about c is inside the pyramid of view when n.(c - eye) >= r for each of the pyramid's four
    inward unit normals n. Only the least n.c - r over all spheres matters, so the action is taken in piece by piece.

    Args:
        aspect: the picture's width over its height.
        azimuth: where one looks from, from the front (+Z) toward +X [degrees].
        elevation: from level toward above [degrees].
    """

    def __init__(self, aspect: float, azimuth: float = AZIMUTH, elevation: float = ELEVATION):
        around, above = np.radians([float(azimuth), float(elevation)])
        self.half_height = float(np.tan(VERTICAL_VIEW / 2.0))
        self.half_width = self.half_height * aspect
        backward = np.array([np.sin(around) * np.cos(above), np.sin(above), np.cos(around) * np.cos(above)])
        right = np.array([np.cos(around), 0.0, -np.sin(around)])
        self.axes = np.stack([right, np.cross(backward, right), backward])
        half = MARGIN * np.array([self.half_width, self.half_height])
        self._cosines = 1.0 / np.hypot(1.0, half)
        self._sines = half * self._cosines
        self._support = np.full((2, 2), np.inf)

    def include(self, centers: NDArray[np.float64], radii: NDArray[np.float64] | float = 0.0) -> None:
        """Take in spheres: centers of shape (n, 3), radii of shape (n,) or one for all."""
        seen = centers @ self.axes.T
        for axis in range(2):
            inward = -self._sines[axis] * seen[:, 2] - radii
            across = self._cosines[axis] * seen[:, axis]
            for side, sign in enumerate((1.0, -1.0)):
                least = float(np.min(sign * across + inward, initial=np.inf))
                self._support[axis, side] = min(self._support[axis, side], least)

    def camera(self) -> Camera:
        """Return the camera for all that was taken in."""
        middle = (self._support[:, 0] - self._support[:, 1]) / (2.0 * self._cosines)
        back = -self._support.sum(axis=1) / (2.0 * self._sines)
        eye = np.array([*middle, back.max()]) @ self.axes
        return Camera(eye, self.axes, self.half_width, self.half_height)


def turned(level_axes: NDArray[np.float64], light: float) -> NDArray[np.float64]:
    """Return a camera's level axes, shape (3, 3), turned so that its main light comes from an azimuth [degrees].

    A studio lit from the right is the mirror image of one lit from the left: its other lamp must not get behind the
    scene, whose outlines would shine.
    """
    right, up, backward = level_axes
    if light > 0.0:
        right, light = -right, -light
    angle = np.radians(light - KEY_AZIMUTH)
    return np.stack(
        [np.cos(angle) * right - np.sin(angle) * backward, up, np.sin(angle) * right + np.cos(angle) * backward]
    )


RADIUS, BEND, HEIGHT = 9.0, 7.0, 9.0
"""Radius of the floor, radius of the curve between floor and wall, and height of the wall, in sizes of the subject"""
OPEN = (-0.6, 0.2)
"""Cosines of the angle from straight behind the subject between which the wall comes down to the floor: there is none
in front"""
AROUND, FLAT, CURVED, UPRIGHT = 96, 6, 14, 2
"""Number of faces around the subject, and of the floor, the curve and the wall from bottom to top"""
FLOOR_GLOW, WALL_GLOW = 0.18, 0.95
"""Fractions of their color that floor and wall emit, as if lamps of their own lit them evenly"""
GLOW_RISES = (0.0, 0.8)
"""Heights between which the one becomes the other, in sizes of the subject"""
ROUGHNESS = 0.9


def define_backdrop(
    stage: Usd.Stage,
    path: Sdf.Path,
    foot: NDArray[np.float64],
    level_axes: NDArray[np.float64],
    size: float,
    paper: Color,
) -> None:
    """Define the sheet, in the coordinates of the prim's parent, where Y is up.

    Args:
        foot: the point of the floor below the subject, shape (3,).
        level_axes: unit vectors to the right, up, and level back toward the camera, a row each, shape (3, 3).
        size: of the subject.
        paper: color of the sheet.
    """
    sheet = sweep()
    points = Vt.Vec3fArray.FromNumpy((size * sheet.points @ level_axes + foot).astype(np.float32))
    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(points)
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(sheet.face_vertex_counts))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(sheet.face_vertex_indices))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy((vertex_normals(sheet) @ level_axes).astype(np.float32)))
    prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    prim.CreateDoubleSidedAttr(True)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    prim.CreatePurposeAttr(UsdGeom.Tokens.render)  # a viewer that frames prims of default purpose frames the subject
    for key in (SCENERY, BACKDROP):
        prim.GetPrim().SetCustomDataByKey(key, "Backdrop")
    _light_from_within(prim, sheet.points[:, 1], paper)


def glow_like_floor(ground: Usd.Prim, paper: Color) -> None:
    """Make the ground emit light as the sheet below it does, so that the transition is invisible."""
    material = UsdShade.MaterialBindingAPI(ground).ComputeBoundMaterial()[0]
    emission_input(material).Set(FLOOR_GLOW * Gf.Vec3f(*paper))


def _light_from_within(prim: UsdGeom.Mesh, heights: NDArray[np.float64], paper: Color) -> None:
    material = paint(prim, paper, roughness=ROUGHNESS)
    shares = FLOOR_GLOW + (WALL_GLOW - FLOOR_GLOW) * _smooth_step(*GLOW_RISES, heights)
    colors = np.outer(shares, paper).astype(np.float32)
    kind, each_point = Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar("glow", kind, each_point).Set(Vt.Vec3fArray.FromNumpy(colors))
    take_from_primvar(emission_input(material), "glow", FLOOR_GLOW * Gf.Vec3f(*paper))


def sweep() -> PolygonMesh:
    """Return the sheet for a subject of size 1 above the origin, whose camera looks along -Z."""
    outward, upward = _profile()
    angles = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    rise = _smooth_step(*OPEN, np.cos(angles))[:, None]
    rings = np.stack([np.sin(angles)[:, None] * outward, rise * upward, -np.cos(angles)[:, None] * outward], axis=-1)
    first = 1 + np.arange(AROUND)[:, None] * len(outward)  # after the point in the middle
    following = np.roll(first, -1, axis=0)
    place = np.arange(len(outward) - 1)
    quads = np.stack([first + place, following + place, following + place + 1, first + place + 1], axis=-1)
    fan = np.concatenate([np.zeros_like(first), following, first], axis=1)
    counts = np.repeat([3, 4], [len(fan), quads.size // 4]).astype(np.int32)
    corners = np.concatenate([fan.ravel(), quads.ravel()]).astype(np.int32)
    return PolygonMesh(np.concatenate([np.zeros((1, 3)), rings.reshape(-1, 3)]), counts, corners)


def _profile() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return distance and height of the sheet straight behind the subject."""
    flat = np.linspace(0.0, RADIUS - BEND, FLAT + 1)[1:]
    turn = np.linspace(0.0, 0.5 * np.pi, CURVED + 1)[1:]
    wall = np.linspace(BEND, HEIGHT, UPRIGHT + 1)[1:]
    outward = np.concatenate([flat, RADIUS - BEND + BEND * np.sin(turn), np.full(len(wall), RADIUS)])
    upward = np.concatenate([np.zeros(len(flat)), BEND - BEND * np.cos(turn), wall])
    return outward, upward


def _smooth_step(begin: float, end: float, value: NDArray[np.float64]) -> NDArray[np.float64]:
    t = np.clip((value - begin) / (end - begin), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


class Softbox(NamedTuple):
    """A rectangular lamp that faces the subject. Lengths are in sizes of the subject."""

    toward: tuple[float, float, float]
    """Direction from the subject: right, up, and back, as the camera sees it unless the light is turned"""
    distance: float
    width: float
    height: float
    power: float
    """Intensity at a subject of size 1: the total power, whatever its size"""
    color: Color = (1.0, 1.0, 1.0)


SOFTBOXES = {
    "Key": Softbox((-0.62, 1.0, 0.62), 4.0, 1.7, 2.2, 30.0, (1.0, 0.97, 0.92)),
    "Rim": Softbox((0.9, 0.62, -0.3), 4.0, 0.6, 4.4, 20.0, (0.95, 0.98, 1.0)),
    "Top": Softbox((0.0, 1.0, 0.0), 6.0, 5.0, 5.0, 8.0),
}
SKY, SKY_COLOR = 0.1, (0.90, 0.95, 1.0)
"""Intensity and color of the uniform sky"""


def define_lights(
    stage: Usd.Stage, home: Sdf.Path, center: NDArray[np.float64], level_axes: NDArray[np.float64], size: float
) -> None:
    """Define sky and softboxes below a prim, in whose coordinates Y is up.

    Args:
        center: the subject's middle, shape (3,).
        level_axes: unit vectors by which directions to lamps are given, a row each, shape (3, 3).
        size: of the subject.
    """
    sky = UsdLux.DomeLight.Define(stage, home.AppendChild("Sky"))
    sky.CreateIntensityAttr(SKY)
    sky.CreateColorAttr(Gf.Vec3f(*SKY_COLOR))
    for name, box in SOFTBOXES.items():
        light = UsdLux.RectLight.Define(stage, home.AppendChild(name))
        light.CreateNormalizeAttr(True)
        light.CreateIntensityAttr(box.power * size**2)
        light.CreateColorAttr(Gf.Vec3f(*box.color))
        light.CreateWidthAttr(box.width * size)
        light.CreateHeightAttr(box.height * size)
        toward = np.array(box.toward) @ level_axes / np.linalg.norm(box.toward)
        matrix = np.eye(4)
        matrix[:3, :3] = _facing(toward)
        matrix[3, :3] = center + box.distance * size * toward
        UsdGeom.Xformable(light).AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))


def _facing(backward: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes of a lamp that shines against a direction, a row each: to its right, up and backward."""
    straight = abs(backward[1]) > 0.99
    right = np.cross([0.0, 0.0, -1.0] if straight else [0.0, 1.0, 0.0], backward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(backward, right), backward])


OURS = "balloonWarp"
"""Key of the custom data that tells our camera from a user's: pictures find a better place for each themselves"""
ASPECT = 16.0 / 9.0
FOCAL_LENGTH = 0.5
"""Focal length in tenths of the stage's unit, as USD has it: 50 mm where that is a meter"""


def fit_for(scene: Scene) -> CameraFit:
    """Begin to find the camera for a wide picture, from where the scene's picture looks."""
    said = scene.picture
    azimuth = AZIMUTH if said is None or said.azimuth is None else said.azimuth
    elevation = ELEVATION if said is None or said.elevation is None else said.elevation
    return CameraFit(ASPECT, azimuth, elevation)


def as_pictured(camera: Camera, center: NDArray[np.float64], scene: Scene) -> Camera:
    """Return a camera with the target and the zoom of the scene's picture.

    Args:
        center: of the camera's subject, Y up, shape (3,).
    """
    if scene.picture is None:
        return camera
    if scene.picture.look_at is not None:
        middle = np.array(scene.picture.look_at) @ (Z_TO_Y_UP if scene.up_axis == "Z" else np.eye(3))
        camera = camera.looking_at(middle, center)
    return camera.zoomed(scene.picture.zoom)


def define_camera(stage: Usd.Stage, path: Sdf.Path, camera: Camera, sharp: NDArray[np.float64]) -> None:
    """Define a camera in the coordinates of its parent, where Y is up.

    Args:
        sharp: the point that is in focus, shape (3,).
    """
    prim = UsdGeom.Camera.Define(stage, path)
    prim.GetPrim().SetCustomDataByKey(OURS, "frames the run")
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = camera.axes, camera.eye
    prim.AddTransformOp().Set(Gf.Matrix4d(matrix.tolist()))
    prim.CreateFocalLengthAttr(FOCAL_LENGTH)
    prim.CreateHorizontalApertureAttr(2.0 * FOCAL_LENGTH * camera.half_width)
    prim.CreateVerticalApertureAttr(2.0 * FOCAL_LENGTH * camera.half_height)
    distance = float(np.linalg.norm(camera.eye - sharp))
    prim.CreateFocusDistanceAttr(distance)
    prim.CreateClippingRangeAttr(Gf.Vec2f(0.01 * distance, 1000.0 * distance))


HOME = Sdf.Path("/World/Studio")
GROUND, OBSTACLES = Sdf.Path("/World/Ground"), Sdf.Path("/World/Obstacles")
MOST_FRAMES = 40
"""Number of frames sampled to find the subject's place"""
HOVER = 0.6
"""Height of the subject above the floor where nothing stands on one, in sizes of the subject"""
LARGE = 12.0
"""Size of an obstacle, in sizes of the subject, from which on it is a floor or a wall itself"""
BELOW = 1e-3
"""Depth of the backdrop below the things that stand on it, in sizes of the subject"""


@dataclass
class Bounds:
    """The box around all points that were taken in, Y up."""

    lower: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    """Lowest corner, shape (3,)"""
    upper: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))
    """Highest corner, shape (3,)"""

    def include(self, points: NDArray[np.float64]) -> None:
        """Take in points, shape (n, 3)."""
        self.lower = np.minimum(self.lower, points.min(axis=0))
        self.upper = np.maximum(self.upper, points.max(axis=0))

    @property
    def center(self) -> NDArray[np.float64]:
        """Center, shape (3,)."""
        return 0.5 * (self.lower + self.upper)

    @property
    def size(self) -> float:
        """Longest side; not finite without points."""
        return float((self.upper - self.lower).max())


def define_studio(
    stage: Usd.Stage, scene: Scene, paths: Sequence[Sdf.Path], frames: Sequence[int], *, backdrop: bool = True
) -> None:
    """Define a camera, and lights and a backdrop around its subject; nothing where there is no subject.

    Args:
        scene: whose picture says from where to look.
        paths: of the prims that matter.
        frames: whose time samples are there.
        backdrop: whether there is one.
    """
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(int))
    moments = [frames[place] for place in chosen.tolist()]
    fit, subject = fit_for(scene), Bounds()
    for points in _points(stage, paths, moments):
        fit.include(points)
        subject.include(points)
    if not np.isfinite(subject.size) or subject.size <= 0.0:
        return
    shown, center, size = replace(subject), subject.center, subject.size
    lowest = subject.lower[1]
    for points in _obstacles(stage, size, moments):
        lowest = min(lowest, points[:, 1].min())
        if scene.picture is not None:  # whose zoom is of all that is shown
            fit.include(points)
            shown.include(points)
    home = UsdGeom.Xform.Define(stage, HOME)
    if scene.up_axis == "Z":  # its children are placed as if Y were up
        home.AddRotateXOp().Set(90.0)
    camera = as_pictured(fit.camera(), shown.center, scene)
    define_camera(stage, HOME.AppendChild("Camera"), camera, center)
    said = scene.picture and scene.picture.light
    define_lights(stage, HOME, center, turned(camera.level_axes, KEY_AZIMUTH if said is None else said), size)
    if backdrop:
        heights = [points[:, 1].min() for points in _points(stage, [GROUND], moments)]
        hovers = lowest == subject.lower[1]
        floor = min(heights, default=lowest - HOVER * size if hovers else lowest)
        foot = np.array([center[0], floor - BELOW * size, center[2]])
        define_backdrop(stage, HOME.AppendChild("Backdrop"), foot, camera.level_axes, size, paper_of(scene))


def _obstacles(stage: Usd.Stage, size: float, moments: Sequence[int]) -> Iterator[NDArray[np.float64]]:
    """Return the points of those that are no floor or wall themselves, shape (n, 3) each."""
    obstacles = stage.GetPrimAtPath(OBSTACLES)
    paths = [prim.GetPath() for prim in obstacles.GetChildren()] if obstacles else []
    return (points for points in _points(stage, paths, moments) if np.ptp(points, axis=0).max() < LARGE * size)


def _points(stage: Usd.Stage, paths: Sequence[Sdf.Path], moments: Sequence[int]) -> Iterator[NDArray[np.float64]]:
    """Return the points of each mesh at some frames, or the corners of other prims' boxes, Y up, shape (n, 3) each."""
    purposes = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render, UsdGeom.Tokens.proxy]
    prims = [prim for path in paths if (prim := stage.GetPrimAtPath(path))]
    for frame in moments:
        moment, boxes = Moment(stage, frame), UsdGeom.BBoxCache(Usd.TimeCode(frame), purposes)
        for prim in prims:
            if UsdGeom.Mesh(prim):
                points = _seen(UsdGeom.Mesh(prim), frame)
            elif UsdGeom.PointBased(prim):
                points = UsdGeom.PointBased(prim).GetPointsAttr().Get(frame)
            else:
                box = boxes.ComputeUntransformedBound(prim).ComputeAlignedRange()
                points = [] if box.IsEmpty() else [box.GetCorner(number) for number in range(8)]
            if len(points):
                yield moment.place(prim, np.array(points, np.float64))


def _seen(mesh: UsdGeom.Mesh, frame: int) -> NDArray[np.float64]:
    """Return the points of a mesh at a frame, without those that a tear cut off from all faces, shape (n, 3)."""
    points, corners = np.array(mesh.GetPointsAttr().Get(frame)), mesh.GetFaceVertexIndicesAttr()
    if not corners.GetNumTimeSamples():
        return points
    counts, numbers = np.array(mesh.GetFaceVertexCountsAttr().Get(frame)), np.array(corners.Get(frame))
    begins = np.cumsum(counts) - counts
    is_there = np.logical_or.reduceat(numbers != np.repeat(numbers[begins], counts), begins)
    return points[np.unique(numbers[np.repeat(is_there, counts)])] if is_there.any() else points
