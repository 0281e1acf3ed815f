"""Options that commands share, names of outputs, limits of a shell, and usage errors in one sentence."""

import os
import re
import shlex
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, signature
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, TypedDict, cast, get_args, get_type_hints

import typer
from pydantic import ValidationError
from typer.core import TyperCommand

from balloon_warp.errors import InputError, ask, did_you_mean
from balloon_warp.mesh.crossings import Taken
from balloon_warp.mesh.load import LARGEST_GAP, LEAST_GAP, Parts, load_mesh
from balloon_warp.mesh.polygon_mesh import METERS, UpAxis
from balloon_warp.run.report import command_without_folders
from balloon_warp.scene import Scene
from balloon_warp.scene.balloon import Balloon
from balloon_warp.scene.load import (
    Override,
    OverrideError,
    bundled_scenes,
    files_of_scene,
    load_scene,
    mesh_balloon,
    override_scene,
    parse_override,
)
from balloon_warp.scene.scene import MESHED
from balloon_warp.system.files import STAGES, is_ours, replacing_any, require_ours

GIB = 2**30
NEEDED = {"-v": ("RLIMIT_AS", 1.75 * GIB, 0.25 * GIB), "-d": ("RLIMIT_DATA", 0.5 * GIB, 0.125 * GIB)}
"""Limits by the options of `ulimit`: addresses, and data, of a small run with a picture, measured on 1 and 2 cores, and
those of the threads of each core beside that [bytes]"""
MOST_CORES = 16
"""Most cores for which libraries start threads"""


def require_addresses() -> None:
    """Make sure that USD, Warp and the others find room, before they are loaded.

    Raises:
        InputError: `ulimit` leaves the process less than they take.
    """
    try:
        import resource
    except ModuleNotFoundError:  # Windows has none
        return
    for option, (name, least, per_core) in NEEDED.items():
        needed = int(least + per_core * min(os.cpu_count() or 1, MOST_CORES))
        soft, _ = resource.getrlimit(getattr(resource, name))
        if soft != resource.RLIM_INFINITY and soft < needed:
            raise InputError(
                f"ulimit {option}: {soft // 1024} is less than the libraries take on this machine; expected at least "
                f"{needed // 1024}, {needed / GIB:.3g} GiB, or unlimited"
            )


def own_name(usual: Path, scene: Scene | None = None) -> Path:
    """Return a name whose file is not there, or is ours to replace: the usual one, or another if that is an input.

    Args:
        scene: whose meshes, with their textures, and other files are the inputs.

    Raises:
        InputError: somebody else's file is in its place.
    """
    name = usual.with_stem(f"{usual.stem}_balloon") if scene and _is_input(usual, scene) else usual
    require_ours(name)
    return name


def _is_input(path: Path, scene: Scene) -> bool:
    return path.exists() and any(os.path.realpath(path) == os.path.realpath(each) for each in _inputs(scene, path))


def _inputs(scene: Scene, path: Path) -> Iterator[Path]:
    """Iterate over the files that a scene names, and, if another's picture is at the path, that its meshes name."""
    yield from files_of_scene(scene)
    if path.suffix.lower() in STAGES or is_ours(path):
        return
    for meshed in (each for name in MESHED for each in getattr(scene, name) if isinstance(each.mesh, Path)):
        looks = load_mesh(meshed.mesh, meshed.prim).looks
        yield from (picture.file for picture in looks.pictures if picture.file) if looks else ()


def command_line(context: typer.Context, without: Collection[str] = ()) -> str:
    """Write the command as a shell takes it, its arguments and the options given in the order of its help.

    Absolute paths lose their folders: who reads it elsewhere learns nothing from them.

    Args:
        context: of the command.
        without: names of parameters that are left out: those which do not change the result, but its place.
    """
    words = ["balloon-warp", str(context.info_name)]
    for parameter in context.command.params:
        name = str(parameter.name)
        source = context.get_parameter_source(name)
        if source is None or source.name != "COMMANDLINE" or name in without:
            continue
        value = context.params[name]
        for each in value if isinstance(value, list | tuple) else [value]:
            if parameter.param_type_name == "option":
                words.append(max(parameter.opts, key=len))
            if not isinstance(each, bool):
                words.append(str(each))
    return (
        shlex.join(command_without_folders(words)).encode(errors="replace").decode()
    )  # names of files may be no Unicode


UsageError = cast("type[Exception]", typer.BadParameter.__base__)
"""Base of Typer's usage errors, whose place differs from version to version"""
ALSO_CALLED = {"duration": "--seconds", "length": "--seconds", "out": "--output", "framerate": "--fps", "rate": "--fps"}
"""Options by names that other programs have for them"""


def usage_sentence(error: Any, program: Any, words: Sequence[str]) -> str:
    """Return a sentence on the error, the expectation, and where to read more.

    Args:
        error: A `UsageError`.
        program: Typer's group of all commands.
        words: Words after the program's name.
    """
    name = words[0] if words[0] in program.commands else ""
    command = program.commands.get(name, program)
    mistake = _mistake(error, command, name or "balloon-warp", words)
    path = f"balloon-warp {name}" if name else "balloon-warp"
    return mistake if mistake.endswith("?") else f"{mistake}; {path} --help explains"


def _mistake(error: Any, command: Any, name: str, words: Sequence[str]) -> str:
    option, parameter = getattr(error, "option_name", None), getattr(error, "param", None)
    if option and hasattr(error, "possibilities"):  # newer versions have some for a command, too
        known = [text for each in command.params for text in each.opts if text.startswith("--")]
        written = next((word for word in words if word.startswith(str(option))), str(option))
        return f"{written}: unknown option of {name}{_option_meant(written, known)}"
    if option:
        metavar = next((each.metavar for each in command.params if option in each.opts), None)
        return f"{option}: has no value; expected {option} {metavar}" if metavar else f"{option}: takes no value"
    if parameter is not None and type(error).__name__ == "MissingParameter":
        return f"{name}: {_called(parameter)} is missing"
    if parameter is not None:
        return f"{_called(parameter)}: {_expected(error)}"
    if extra := re.search(r"unexpected extra .*\((.*)\)", error.message):
        return f"{name}: did not expect {extra[1]}{'; --set goes before PATH=VALUE' if '=' in extra[1] else ''}"
    if unknown := re.match("No such command ['\"](.*?)['\"]", error.message):
        return f"{unknown[1]}: no such command{_command_meant(unknown[1], command.commands)}"
    return error.message.rstrip(".")


def _option_meant(written: str, known: Sequence[str]) -> str:
    """End a sentence with the option that another program calls so, the field of a scene, or a name that is like it."""
    field = written.partition("=")[0].lstrip("-").replace("-", "_")
    if ALSO_CALLED.get(field) in known:
        return ask([ALSO_CALLED[field]])
    if field == "vary":
        return "; `batch` and `compare` have it"
    if field in Scene.model_fields and "--set" in known and f"--{field}" not in known:
        return ask([f"--set {field}="])
    return did_you_mean(written, known)


def _command_meant(word: str, commands: Iterable[str]) -> str:
    if word in bundled_scenes() or Path(word).is_file():
        return ask([f"balloon-warp run {word}"])
    return did_you_mean(word, commands) or f"; commands are {', '.join(commands)}"


def _called(parameter: Any) -> str:
    """Name an option by its long name, an argument by its metavar in the help."""
    if parameter.param_type_name == "argument":
        return parameter.metavar
    return max(parameter.opts, key=len)


def _expected(error: Any) -> str:
    """Return Pydantic's sentence, where newer versions of Typer have it from there, and the value found."""
    message = re.split(", (?:unable|got) ", error.message.rstrip("."))[0].replace("Input should", "must")
    found = error.__cause__.errors()[0]["input"] if isinstance(error.__cause__, ValidationError) else None
    return message if found is None else f"{message} (got {found})"


def parse_size(text: str) -> tuple[int, int]:
    """Return the width and height of `WIDTHxHEIGHT`.

    Raises:
        InputError: the text has another form.
    """
    match = re.fullmatch(r"(\d{1,12})[xX](\d{1,12})", text)
    if not match:
        raise InputError(f"size: {text[:40]!r}; expected WIDTHxHEIGHT in pixels, such as 960x540")
    return int(match[1]), int(match[2])


def parse_frames(text: str) -> tuple[int | None, int | None]:
    """Read the first and the last of `FIRST:LAST`, either of which may be missing.

    Raises:
        InputError: the text has another form.
    """
    match = re.fullmatch(r"(-?\d{1,9})?:(-?\d{1,9})?", text)
    if not match:
        raise InputError(f"--frames {text[:40]}: expected FIRST:LAST, such as 10:90, :90 or 10:")
    first, last = (int(word) if word else None for word in match.groups())
    return first, last


def parse_place(text: str, option: str = "look-at") -> str | tuple[float, float, float]:
    """Read a point of `X,Y,Z`, or a name, which has no comma.

    Raises:
        InputError: the text has commas and is no point.
    """
    if "," not in text:
        return text
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        raise InputError(f"--{option} {text[:40]}: expected X,Y,Z in the stage's unit, or a prim's name") from None
    return x, y, z


EXACT = "exact"
"""Value of `--weld` without a number, which may also be typed"""


class Command(TyperCommand):
    """A command whose `--weld` may stand alone: the next word is its value only if it is a number."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, with_values(args))

    def invoke(self, ctx: Any) -> Any:
        require_addresses()  # before the command loads modules that would not find room
        return super().invoke(ctx)


def with_values(words: list[str]) -> list[str]:
    """Return the words of a command line, with a value after each `--weld` that has none."""
    end = words.index("--") if "--" in words else len(words)
    filled: list[str] = []
    for word, following in zip_longest(words[:end], words[1:end]):
        filled += [word, EXACT] if word == "--weld" and following != EXACT and _number(following) is None else [word]
    return filled + words[end:]


def weld_of(said: str | None) -> bool | float | None:
    """Return the value of the scene's field for `--weld`.

    Raises:
        InputError: it is neither alone nor such a part.
    """
    if said in (None, EXACT):
        return None if said is None else True
    gap = _number(said)
    if gap is None or not LEAST_GAP <= gap <= LARGEST_GAP:
        expected = f"a fraction of the mesh's size from {LEAST_GAP:g} to {LARGEST_GAP:g}, such as 1e-4"
        raise InputError(f"--weld {said}: expected {expected}, or no value")
    return gap


def _number(word: str | None) -> float | None:
    try:
        return float(word or "")
    except ValueError:
        return None


CAMERA = "Camera"
"""Heading of a section of the help"""


class RenderOptions(TypedDict):
    """Options of `render_stage`."""

    azimuth: float | None
    elevation: float | None
    zoom: float | None
    look_at: str | tuple[float, float, float] | None
    follow: bool
    aperture: float
    focus: str | tuple[float, float, float] | None
    shutter: float
    transparent: bool


@dataclass(frozen=True)
class CameraOptions:
    """Options of commands with a camera."""

    azimuth: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Azimuth of the camera: 0 is the front, 90 the right, 180 the back. 32 if not given.",
            rich_help_panel=CAMERA,
        ),
    ] = None
    elevation: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Elevation of the camera: 0 is level, 90 is straight from above. 13 if not given.",
            rich_help_panel=CAMERA,
        ),
    ] = None
    zoom: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR", help="Magnification: 2 doubles the size in the picture.", rich_help_panel=CAMERA
        ),
    ] = None
    look_at: Annotated[
        str | None,
        typer.Option(
            "--look-at",
            metavar="NAME|X,Y,Z",
            help="Center of the picture: a prim of the stage, such as String_0, or a point. If not given, "
            "all that moves.",
            rich_help_panel=CAMERA,
        ),
    ] = None
    follow: Annotated[
        bool,
        typer.Option(
            "--follow",
            metavar="",
            help="Track the balloons with the camera, or the target of --look-at.",
            rich_help_panel=CAMERA,
        ),
    ] = False
    aperture: Annotated[
        float,
        typer.Option(
            metavar="WIDTH",
            help="Diameter of the lens, in the stage's unit. A wider lens has less depth of field around --focus.",
            rich_help_panel=CAMERA,
        ),
    ] = 0.0
    focus: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|X,Y,Z",
            help="Prim or point in focus. If not given, the center of the picture.",
            rich_help_panel=CAMERA,
        ),
    ] = None
    shutter: Annotated[
        float,
        typer.Option(
            metavar="FRAMES",
            help="Shutter time, 0 to 1 frame, for motion blur.",
            rich_help_panel=CAMERA,
        ),
    ] = 0.0
    transparent: Annotated[
        bool,
        typer.Option(
            "--transparent",
            metavar="",
            help="Omit backdrop, ground and water, but keep the shadow, for a .png or .webp to composite.",
            rich_help_panel=CAMERA,
        ),
    ] = False

    def asked(self) -> RenderOptions:
        """Return the options as arguments of `render_stage`.

        Raises:
            InputError: a place has another form.
        """
        places = {
            name: parse_place(place, name.replace("_", "-")) if place else None
            for name, place in (("look_at", self.look_at), ("focus", self.focus))
        }
        return cast("RenderOptions", vars(self) | places)


SCENE, OUTPUT, MACHINE, LONG = "Scene", "Output", "Execution", "Long runs and failures"
"""Headings of the sections of a command's help"""
SceneName = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="A bundled scene (`balloon-warp scenes` lists them), a scene file (.toml), or a mesh: OBJ, "
        "USD, STL, PLY, OFF, glTF or GLB.",
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Change a value of the scene: balloon.mass=0.2, sphere.0.radius=0.3, gravity=0. May be repeated.",
        rich_help_panel=SCENE,
    ),
]
PartsOption = Annotated[
    str | None,
    typer.Option(
        "--parts",
        metavar="|".join(get_args(Taken)),
        help="Parts of the mesh that make up the balloon: all, the closed ones, without loose ribbons such "
        "as hair, or the largest.",
        rich_help_panel=SCENE,
    ),
]
PrimOption = Annotated[
    str | None,
    typer.Option(
        "--prim",
        metavar="NAME",
        help="Object of the mesh file: by its name, or in a USD stage by its path, such as /Room/Wall0, "
        "or that of what it stands in.",
        rich_help_panel=SCENE,
    ),
]
UpOption = Annotated[
    str | None,
    typer.Option(
        "--up",
        metavar="Y|Z",
        help="Up axis of the mesh file. CAD, scans and many STL files have Z.",
        rich_help_panel=SCENE,
    ),
]


def _device_to(work: str) -> Any:
    return typer.Option(
        metavar="NAME",
        help=f"Device to {work} on: cpu, cuda:0 and so on. If not given, the GPU if there is one.",
        rich_help_panel=MACHINE,
    )


Device = Annotated[str | None, _device_to("simulate")]
RenderDevice = Annotated[str | None, _device_to("render")]
Schedule = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Parallel schedule, which affects speed only: auto, scatter, gather, block, lanes or octets.",
        rich_help_panel=MACHINE,
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", metavar="", help="Print JSON to standard output, for other programs.", rich_help_panel=OUTPUT
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        metavar="",
        help="Also replace files that Balloon Warp did not write, or that were edited since.",
        rich_help_panel=OUTPUT,
    ),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        metavar="",
        help="Resume from the last checkpoint of the same command.",
        rich_help_panel=LONG,
    ),
]
Size = Annotated[
    str, typer.Option(metavar="WIDTHxHEIGHT", help="Size of each picture in pixels.", rich_help_panel=OUTPUT)
]


@dataclass(frozen=True)
class MeshOptions:
    """Options of commands that read a mesh file."""

    weld: Annotated[
        str | None,
        typer.Option(
            "--weld",
            metavar="[GAP]",
            help="Weld open seams whose gap is at most this fraction of the mesh's size, such as 1e-4. "
            "Without a number, weld wherever vertices coincide exactly.",
            rich_help_panel=SCENE,
        ),
    ] = None
    parts: PartsOption = None
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            metavar="|".join(METERS),
            help="Unit of the mesh's coordinates. The mesh then has its true size and, without "
            "a scene file, true gravity.",
            rich_help_panel=SCENE,
        ),
    ] = None
    prim: PrimOption = None
    up: UpOption = None
    inflate: Annotated[
        float | None,
        typer.Option(
            "--inflate",
            metavar="STRETCH",
            help="Stretch of the skin of each balloon without other inflation: 0.2 makes a sphere's radius a fifth "
            "larger, a volume of 1.73. 0.08 by default for a mesh by itself, a volume of 1.26, to which other shapes "
            "swell, too.",
            rich_help_panel=SCENE,
        ),
    ] = None


@dataclass(frozen=True)
class LengthOptions:
    """Options of commands that set the simulated time."""

    fps: Annotated[
        float | None,
        typer.Option(
            "--fps", metavar="RATE", help="Frame rate in frames per second, such as 24.", rich_help_panel=SCENE
        ),
    ] = None
    frames: Annotated[
        int | None,
        typer.Option("--frames", metavar="COUNT", help="Number of frames to simulate.", rich_help_panel=SCENE),
    ] = None
    seconds: Annotated[
        float | None,
        typer.Option(
            "--seconds",
            metavar="TIME",
            help="Duration in seconds, instead of --frames.",
            rich_help_panel=SCENE,
        ),
    ] = None


LISTED_ELSEWHERE = "listed elsewhere"
"""Mark of options that the help of another command lists"""


def spread(command: Callable[..., None], writes: bool = False) -> Callable[..., None]:
    """Return a command as Typer wants it: with every field of a dataclass that it takes as an option of its own.

    Args:
        command: of whose keyword arguments some are dataclasses, whose fields are annotated as options; one that is
            annotated by `LISTED_ELSEWHERE` is not in its help.
        writes: whether it writes files whose names nobody gave, and so has the option `--force`.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in get_type_hints(command).items() if is_dataclass(kind)}
    parameters: list[Parameter] = []
    for name, parameter in signature(command).parameters.items():
        if name in groups:
            parameters += _options(groups[name], LISTED_ELSEWHERE in getattr(hints[name], "__metadata__", ()))
        else:
            parameters.append(parameter.replace(annotation=hints[name]))
    if writes:
        parameters.append(Parameter("force", Parameter.KEYWORD_ONLY, default=False, annotation=Force))

    @wraps(command)
    def spread_out(force: bool = False, **given: Any) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{each.name: given.pop(each.name) for each in fields(kind)})
        with replacing_any(force):
            command(**given)

    spread_out.__dict__["__signature__"] = signature(command).replace(parameters=parameters)
    spread_out.__annotations__ = {each.name: each.annotation for each in parameters}
    return spread_out


def _options(group: Any, hidden: bool) -> list[Parameter]:
    hints = get_type_hints(group, include_extras=True)
    if hidden:
        hints = {name: _hidden(hint) for name, hint in hints.items()}
    return [
        Parameter(
            each.name,
            Parameter.KEYWORD_ONLY,
            default=Parameter.empty if each.default is MISSING else each.default,
            annotation=hints[each.name],
        )
        for each in fields(group)
    ]


def _hidden(hint: Any) -> Any:
    option = copy(hint.__metadata__[0])
    option.hidden = True
    return Annotated[hint.__origin__, option]


def checked_parts(parts: str | None) -> Taken | None:
    """Check the value of `--parts`.

    Raises:
        InputError: it is none of the possible ones.
    """
    if parts in get_args(Parts):
        raise InputError(
            f"--parts {parts}: expected {', '.join(get_args(Taken))}; did you mean --set balloon.parts={parts}?"
        )
    return _one_of("--parts", parts, get_args(Taken))


def checked_up(up: str | None) -> UpAxis | None:
    """Check the value of `--up`.

    Raises:
        InputError: it is none of the possible ones.
    """
    return _one_of("--up", up, get_args(UpAxis))


def _one_of(option: str, value: str | None, choices: tuple[str, ...]) -> Any:
    if value not in (None, *choices):
        raise InputError(f"{option} {value}: expected {', '.join(choices)}")
    return value


class Changes:
    """Overrides, each with the option that asks for it.

    Args:
        overrides: of `--set`.
        mesh: options of the mesh.
        length: options of the duration.

    Raises:
        InputError: an option is not of the form that it has, or stands beside one that says the same.
    """

    def __init__(
        self,
        overrides: Iterable[str] | None = None,
        mesh: MeshOptions | None = None,
        length: LengthOptions | None = None,
    ):
        mesh, length = mesh or MeshOptions(), length or LengthOptions()
        if length.frames is not None and length.seconds is not None:
            raise InputError("--frames, --seconds: expected only one of them")
        if length.seconds is not None and not 0.0 < length.seconds < 1e9:
            raise InputError(f"--seconds {length.seconds:g}: expected a time above 0")
        if mesh.unit not in (None, *METERS):
            raise InputError(f"--unit {mesh.unit}: expected {', '.join(METERS)}")
        self.overrides: list[Override] = []
        self._options: list[str] = []
        self._seconds = length.seconds
        for text in overrides or []:
            self._add(*parse_override(text))
        for option, path, value in (
            (f"--weld {mesh.weld}", "balloon.weld", weld_of(mesh.weld)),
            (f"--parts {mesh.parts}", "balloon.taken", checked_parts(mesh.parts)),
            (f"--unit {mesh.unit}", "balloon.unit", mesh.unit),
            (f"--prim {mesh.prim}", "balloon.prim", mesh.prim),
            (f"--up {mesh.up}", "balloon.up", mesh.up),
            ("" if length.fps is None else f"--fps {length.fps:g}", "frames_per_second", length.fps),
            (f"--frames {length.frames}", "frames", length.frames),
            ("" if mesh.inflate is None else f"--inflate {mesh.inflate:g}", "balloon.inflation.stretch", mesh.inflate),
        ):
            if value is not None:
                self._add(path, value, option)

    def _add(self, path: str, value: object, option: str = "") -> None:
        self.overrides.append((path, value))
        self._options.append(option or f"--set {path}")

    def load(self, scene: str, vary: Mapping[str, Any] | None = None) -> Scene:
        """Load the scene of that name, changed.

        Args:
            vary: values that will differ between its worlds.

        Raises:
            InputError: names the option whose value is wrong, else the scene.
        """
        with self._naming_options():
            if vary:
                from balloon_warp.model.parameters import scene_to_vary  # loads the simulator

                loaded = scene_to_vary(scene, vary, self.overrides)
            else:
                loaded = load_scene(scene, self.overrides)
        if self._seconds is None:
            return loaded
        frames = max(1, round(self._seconds * loaded.frames_per_second))
        return override_scene(loaded, [("frames", frames)], other_kinds=True)

    def balloon_of(self, mesh: Path) -> Balloon:
        """Make a balloon of a mesh by itself, changed; the mesh is not read.

        Raises:
            InputError: names the option whose value is wrong.
        """
        with self._naming_options():
            return mesh_balloon(mesh, self.overrides)

    @contextmanager
    def _naming_options(self) -> Iterator[None]:
        try:
            yield
        except OverrideError as mistake:
            path, _ = self.overrides[mistake.number]
            raise InputError(f"{self._options[mistake.number]}: {str(mistake).removeprefix(f'{path}: ')}") from None
