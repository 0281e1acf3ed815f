"""Changes of a scene by command-line options."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

from balloon_warp.cli.lone_weld import weld_of
from balloon_warp.cli.options import LengthOptions, MeshOptions
from balloon_warp.errors import InputError
from balloon_warp.mesh.parts import Taken
from balloon_warp.mesh.prepare import Parts
from balloon_warp.mesh.units import METERS, UpAxis
from balloon_warp.scene.load import load_scene, mesh_balloon
from balloon_warp.scene.overrides import Override, OverrideError, override_scene, parse_override
from balloon_warp.scene.schema import Balloon, Scene


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
                from balloon_warp.model.varied_scene import scene_to_vary  # loads the simulator

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
