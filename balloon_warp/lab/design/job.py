"""A run of a design: its steps, its proof, and the folder that it leaves."""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from balloon_warp.errors import BlowUpError, InputError
from balloon_warp.kernels.laws.air import GAS_CONSTANT
from balloon_warp.lab.design.measure import Error, Ruler, error_picture, stacked
from balloon_warp.lab.design.springs import SLOW_SWING, Hold, Reached, swing_rate
from balloon_warp.lab.statics import SealedGas
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import component_labels, mesh_edges
from balloon_warp.scene import Balloon, Inflation, Scene
from balloon_warp.scene.load import write_scene
from balloon_warp.simulator import Simulator
from balloon_warp.system.api import Shown, described
from balloon_warp.system.files import (
    manifest_text,
    png_mark,
    require_no_inputs,
    require_ours,
    require_ours_in,
    sole_writer,
    whole_file,
    without_mark,
)

Values = NDArray[np.float64]


@dataclass(frozen=True)
class DesignStep:
    """A balloon at rest, as it is after a step of its design."""

    ruler: Ruler
    """Ruler of the target shape"""
    number: int
    """Number of steps tried"""
    points: Values
    """Points at rest [m], shape (n, 3)"""
    stretch: float | None
    """Mean stretch [1]; None where it is not known yet"""
    proven: bool = False
    """Whether it is the final simulation from rest"""

    @property
    def label(self) -> str:
        """Label in a few words."""
        return "simulated from rest" if self.proven else f"step {self.number}"

    @cached_property
    def placed(self) -> Values:
        """The points moved and turned onto the wanted shape [m], shape (n, 3)."""
        return self.ruler.aligned(self.points)

    @cached_property
    def error(self) -> Error:
        """Error of the shape."""
        return self.ruler.error(self.points)

    @cached_property
    def off(self) -> Values:
        """Distance of each vertex from the target, over the size, shape (n,)."""
        return self.ruler.distances(self.points)[: len(self.points)]


FAR = 0.02
"""Distance over the size beyond which a vertex counts as misplaced"""
MOST_PLACES = 4
LEAST_VERTICES = 3
FLAT = 0.5
"""Curvature over that of a sphere of the shape's size below which a region is flat"""
SIDES = (("left", "right"), ("bottom", "top"), ("back", "front"))


def places_off(ruler: Ruler, points: Values, help_: str = "") -> list[str]:
    """Return the places where a shape is off by more than `FAR`, the worst first, a sentence each.

    Args:
        points: of the shape [m], shape (n, 3).
        help_: remedy, at the end of each sentence.
    """
    off = np.linalg.norm(ruler.aligned(points) - ruler.mesh.points, axis=1) / ruler.size
    normal = np.abs(((ruler.aligned(points) - ruler.mesh.points) * ruler.normals).sum(axis=1)) / ruler.size
    far = normal > FAR
    ends = mesh_edges(ruler.mesh).ends
    both = far[ends].all(axis=1)
    labels = component_labels(len(off), ends[both, 0], ends[both, 1])
    groups = [np.flatnonzero((labels == label) & far) for label in np.unique(labels[far])]
    groups = sorted((group for group in groups if len(group) >= LEAST_VERTICES), key=lambda group: -normal[group].max())
    return [_sentence(ruler, group, float(normal[group].max()), help_) for group in groups[:MOST_PLACES]]


def _sentence(ruler: Ruler, group: NDArray[np.int64], worst: float, help_: str) -> str:
    middle = ruler.mesh.points[group].mean(axis=0)
    axis = int(np.abs(middle / np.ptp(ruler.mesh.points, axis=0)).argmax())
    side = SIDES[axis][int(middle[axis] > 0.0)]
    flat = ", flat" if _curvature(ruler, group) < FLAT else ""
    return f"the {side} ({len(group)} vertices{flat}) is off by {100.0 * worst:.2g}% of the size{help_}"


def _curvature(ruler: Ruler, group: NDArray[np.int64]) -> float:
    """Return the curvature of a group of vertices over that of a sphere of the shape's size."""
    places, normals = ruler.mesh.points[group], ruler.normals[group]
    reach = np.linalg.norm(places - places.mean(axis=0), axis=1).mean()
    turn = np.linalg.norm(normals - normals.mean(axis=0), axis=1).mean()
    return float(turn / max(reach, 1e-12) * 0.5 * ruler.size)


SAME = 0.01
"""Relative difference up to which a number that one asked for counts as met"""


@described
@dataclass(frozen=True, repr=False)
class Design(Shown):
    """Designed balloon, and its simulation from rest."""

    scene: Scene
    """Scene that runs as it is"""
    folder: Path
    """Folder with the scene and its files"""
    error: Error
    """Error of the simulation from rest, against the target shape"""
    held_error: Error
    """Error of the designed equilibrium: where it is much smaller than `error`, the balloon comes to rest elsewhere"""
    plain_error: Error | None
    """Error of the baseline: the target shape scaled down by the same stretch, of the same material, inflated as
    much"""
    stretch: float
    """Mean stretch of the design [1]"""
    stretch_asked: float | None
    """Stretch that was asked for [1]; None of foil"""
    size: float
    """Largest extent of the simulation from rest [m]"""
    size_asked: float
    """Largest extent that was asked for, or of the target's file [m]"""
    cannot: list[str]
    """Shortcomings, a sentence each"""
    simulated: NDArray[np.float64]
    """Points at rest [m], shape (n, 3)"""

    def report(self) -> dict[str, Any]:
        """Return the design's figures as JSON."""
        errors = {"error": self.error, "held_error": self.held_error, "plain_error": self.plain_error}
        parts = {
            name: None if each is None else {"mean": each.mean, "worst": each.worst} for name, each in errors.items()
        }
        got = {name: getattr(self, name) for name in ("stretch", "stretch_asked", "size", "size_asked")}
        return {**got, **parts, "cannot": self.cannot}

    @property
    def got(self) -> str:
        """Size and stretch in words, each with the requested value where that differs."""
        size = f"{_got(self.size, self.size_asked, ' m')} large"
        return size + (f", stretch {_got(self.stretch, self.stretch_asked)}" if self.stretch_asked else "")

    def __repr__(self) -> str:
        plain = f"; plain shape {self.plain_error}" if self.plain_error else ""
        return f"Design({self.folder}: {self.error} of the size{plain}; {self.got})"


def _got(got: float, asked: float, unit: str = "") -> str:
    same = abs(got - asked) <= SAME * asked
    return f"{got:.3g}{unit}" if same else f"{got:.4g}{unit} (not {asked:.4g}{unit} as asked)"


SLOW = 0.005
"""Speed that counts as rest [sizes a second]"""
SLOW_FOIL = 0.05
"""Speed of foil that counts as rest [sizes a second]: foil is so stiff that it trembles in float32"""
MOST_SECONDS = 30.0
FILL_SECONDS = 1.0
DAMPING_RATE = 12.0
"""Damping rate [1/s], with which it comes to rest within seconds"""
MORE_FRAMES = 30
"""Number of a scene's frames beyond rest"""


@dataclass(frozen=True)
class Simulated:
    """A design at rest."""

    points: NDArray[np.float64]
    """Points of the particles [m], shape (n, 3)"""
    pressure: float
    """Pressure [Pa]"""
    frames: int
    """Number of frames until it was at rest"""


def filled(gas: SealedGas, start_volume: float, molar_mass: float | None = None) -> Inflation:
    """Return the inflation that brings a balloon that begins at the air's pressure to that amount of gas.

    Args:
        molar_mass: of the gas [kg/mol], where its weight counts.
    """
    begins = gas.air_pressure * start_volume / (GAS_CONSTANT * gas.temperature)
    weight = {} if molar_mass is None else {"molar_mass": molar_mass}
    return Inflation(moles=gas.amount - begins, fill_time=FILL_SECONDS, added_mass=0.0, **weight)


def scene_of(balloon: Balloon, description: str, frames: int, gravity: float = 0.0) -> Scene:
    """Return the balloon alone; it passes through itself, since designs are at rest without contact, too."""
    return Scene(description=description, balloon=[balloon], gravity=gravity, frames=frames, touch=False)


def common_fields(mesh: Path | Any, inflation: Inflation) -> dict[str, Any]:
    """Return the fields that balloons of all designs share."""
    return {"mesh": mesh, "parts": "free", "holes": "keep", "weld": False, "inflation": inflation}


def simulate_from_rest(scene: Scene, size: float, device: str | None, slow: float = SLOW) -> Simulated | str:
    """Simulate the scene's balloon; or return why that fails, in a sentence.

    Args:
        size: Size of the target [m].
        device: As for `simulate`.
        slow: Speed that counts as rest [sizes a second].
    """
    try:
        simulator = Simulator(scene, device)
        frame = simulator.relax(slow * size, MOST_SECONDS)
    except (BlowUpError, InputError) as failure:
        return str(failure)
    return Simulated(frame.points[0].astype(np.float64), float(frame.pressures[0]), frame.number)


SCENE, REPORT = "balloon.toml", "report.json"
SAVED = "progress.npz"
JOB = "progress.json"
"""File with the request and progress of a design, from which it resumes"""
OURS = re.compile(
    r"balloon(_\d+)?\.(toml|obj|mtl)|springs\.npz|mould\.(stl|obj)|panels\.obj|pattern\.svg|error\.png"
    r"|report\.json|progress\.(npz|json)"
)
"""Names of the files of designs"""


@contextmanager
def own_folder(folder: Path, inputs: Mapping[Path, str]) -> Iterator[None]:
    """Make the folder, where there is none, and keep others from writing there in the `with` block.

    Raises:
        InputError: it cannot be made, is a file, or has files where ours go that are inputs or somebody else's.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = sorted(path.name for path in folder.iterdir() if OURS.fullmatch(path.name))
    except OSError as error:
        raise InputError(f"{folder}: cannot be the output folder: {error.strerror}") from None
    require_no_inputs((folder / name for name in names), inputs)
    require_ours_in(folder, names, (REPORT, JOB))
    require_ours(folder / SCENE)
    with sole_writer(folder):
        yield


def write_springs(
    path: Path, pairs: NDArray[Any], lengths: NDArray[np.float64], constants: NDArray[np.float64]
) -> None:
    """Write a file of springs, which `balloon.springs` names."""
    with whole_file(path) as temporary:
        np.savez_compressed(temporary, pairs=pairs, rest_lengths=lengths, constants=constants)


def write_stl(path: Path, mesh: PolygonMesh, triangles: NDArray[Any], unit: float = 1000.0) -> None:
    """Write a binary STL file in millimeters, which printers take for granted.

    Args:
        unit: of the file, in the mesh's.
    """
    corners = (unit * mesh.points[triangles]).astype("<f4")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.zeros(len(triangles), dtype=facet)
    facets["normal"], facets["corners"] = normals, corners
    with whole_file(path) as temporary:
        temporary.write_bytes(b"millimeters".ljust(80) + len(facets).to_bytes(4, "little") + facets.tobytes())


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Write the result as a report, for people and programs."""
    with whole_file(path) as temporary:
        temporary.write_text(manifest_text(report), encoding="utf-8")


def write_picture(path: Path, picture: Image.Image) -> None:
    """Write the picture of the errors."""
    with whole_file(path) as temporary:
        picture.save(temporary, format="PNG", optimize=True, pnginfo=png_mark())


MOVED = 0.005
"""Distance between simulated and designed shape, over the size, from which on it is reported"""


class Saved(Protocol):
    """Saved progress of a design."""

    @property
    def steps(self) -> int:
        """Steps tried until now."""
        ...

    def save(self, path: Path) -> None:
        """Write the progress to its file."""
        ...


T = TypeVar("T", bound=Saved)


class Equilibrium(NamedTuple):
    """Equilibrium of forces that was designed."""

    held: Values
    """Places of particles, shape (n, 3)"""
    plain: Values | None
    """Places of the rival's, if there is one"""
    stretch: float
    """Stretch of the design, in the mean"""


@dataclass(frozen=True)
class Job:
    """Request for a design, and its output folder."""

    target: PolygonMesh
    of: str
    stretch: float
    hold: Hold
    thickness: float
    folder: Path
    steps: int
    device: str | None
    resume: bool
    say: Callable[[str], None]
    watch: Callable[[DesignStep], None] = lambda step: None
    """Callback for each step, and for the final simulation"""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Further options of this kind of design"""
    held: NDArray[np.bool_] | None = None
    """Mask of the vertices that are held against gravity, shape (n,); None where nothing is"""

    @property
    def gravity(self) -> float:
        """Return the gravity under which it is designed [m/s^2]."""
        return float(self.options.get("gravity", 0.0))

    @property
    def thickest(self) -> float:
        """Return the largest over the least thickness that the rubber may have."""
        return float(self.options.get("thickest", self.thickness)) / self.thickness

    @cached_property
    def ruler(self) -> Ruler:
        """Ruler of the target shape."""
        return Ruler(self.target, in_place=self.held is not None)

    @property
    def _slow(self) -> float:
        """Return the speed that counts as rest [sizes a second]."""
        if self.held is not None:
            return SLOW_SWING * swing_rate(self.gravity, self.ruler.size)
        return SLOW_FOIL if self.of == "foil" else SLOW

    @property
    def _asked(self) -> dict[str, Any]:
        """Return the request by which a design is recognized."""
        numbers = {"of": self.of, "stretch": self.stretch, "hold": self.hold, "thickness": self.thickness}
        points = self.target.points
        return numbers | dict(self.options) | {"vertices": len(points), "sum": float(np.abs(points).sum())}

    def saved(self, load: Callable[[Path], T]) -> T | None:
        """Return the progress of the same design, if it is to be resumed.

        Args:
            load: reader of a file that `remember` has written.

        Raises:
            InputError: nothing was saved, or of another design.
        """
        if not self.resume:
            with suppress(OSError):
                (self.folder / SAVED).unlink()
            return None
        try:
            told = without_mark(json.loads((self.folder / JOB).read_text(encoding="utf-8")))
            reached = load(self.folder / SAVED)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise InputError(f"{self.folder}: has no design to --resume") from None
        if told != self._asked:
            raise InputError(f"{self.folder}: has another design; --resume needs the same target and options")
        self.say(f"resuming after step {reached.steps}")
        return reached

    def remember(self, reached: Saved) -> None:
        """Save the progress, for `saved`."""
        write_report(self.folder / JOB, self._asked)
        reached.save(self.folder / SAVED)

    def on_step(self, reached: Reached, stretch: float | None = None) -> None:
        """Save the progress, and report it."""
        self.remember(reached)
        step = DesignStep(self.ruler, reached.steps, reached.points, stretch)
        self.say(f"{step.label}: {step.error} of the size")
        self.watch(step)

    def proven(
        self,
        scene: Scene,
        equilibrium: Equilibrium,
        help_: str = "",
        rival: str = "plain, at the same stretch",
        below: Image.Image | None = None,
        mould: Values | None = None,
        **more: Any,
    ) -> Design:
        """Simulate a scene from rest, and write scene, picture and report.

        Args:
            equilibrium: that was designed.
            help_: remedy for places that are off, as the end of a sentence.
            rival: title of its picture.
            below: a picture that stands below the others.
            mould: that of rubber, which is drawn, too, shape (n, 3).
            more: for the report.

        Raises:
            InputError: it blows up or finds no rest.
        """
        self.say("simulating from rest")
        simulated = simulate_from_rest(scene, self.ruler.size, self.device, self._slow)
        if isinstance(simulated, str):
            raise InputError(f"the design does not come to rest: {simulated}; expected a smaller stretch")
        self.watch(DesignStep(self.ruler, self.steps, simulated.points, equilibrium.stretch, proven=True))
        scene = scene.model_copy(update={"frames": 30 * -(-(simulated.frames + MORE_FRAMES) // 30)})
        write_scene(scene, self.folder / SCENE)
        design = self._judged(scene, simulated, equilibrium, help_)
        said = {**self._asked, **design.report(), "pressure": simulated.pressure, **more}
        write_report(self.folder / REPORT, said)
        self.say("drawing the errors")
        shapes = [(f"simulated from rest: {design.got}", simulated.points)]
        shapes += [] if equilibrium.plain is None else [(rival, equilibrium.plain)]
        moulds = [] if mould is None else [("its mould, drawn as large", mould)]
        picture = error_picture(self.ruler, shapes, moulds)
        write_picture(self.folder / "error.png", picture if below is None else stacked(picture, below))
        return design

    def _judged(self, scene: Scene, simulated: Simulated, equilibrium: Equilibrium, help_: str) -> Design:
        """Return the design with its errors and limits."""
        ruler, (held, plain, stretch) = self.ruler, equilibrium
        cannot = places_off(ruler, simulated.points, help_)
        elsewhere = np.linalg.norm(ruler.aligned(simulated.points) - ruler.aligned(held), axis=1).max() / ruler.size
        if elsewhere > MOVED:
            cannot.append(
                f"inflated from rest it settles in another equilibrium than designed, up to {100 * elsewhere:.2g}% off"
            )
        return Design(
            scene=scene,
            folder=self.folder,
            error=ruler.error(simulated.points),
            held_error=ruler.error(held),
            plain_error=None if plain is None else ruler.error(plain),
            stretch=stretch,
            stretch_asked=None if self.of == "foil" else self.stretch,
            size=float(np.ptp(ruler.aligned(simulated.points), axis=0).max()),
            size_asked=ruler.size,
            cannot=cannot,
            simulated=simulated.points,
        )
