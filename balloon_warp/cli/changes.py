"""What the options of a command change in its scene."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import cast, get_args

from balloon_warp.errors import InputError
from balloon_warp.mesh.parts import Taken
from balloon_warp.mesh.units import METERS
from balloon_warp.scene.load import load_scene, mesh_balloon
from balloon_warp.scene.overrides import Override, OverrideError, override_scene, parse_override
from balloon_warp.scene.schema import Balloon, Scene


def checked_parts(parts: str | None) -> Taken | None:
    """What `--parts` says.

    Raises:
        InputError: it is none of what it may be.
    """
    if parts not in (None, *get_args(Taken)):
        raise InputError(f"--parts {parts}: expected {', '.join(get_args(Taken))}")
    return cast("Taken | None", parts)


class Changes:
    """Overrides, each with the option that asks for it.

    Args:
        overrides: of `--set`.
        weld: whether `--weld` is given.
        parts: of `--parts`.
        unit: of `--unit`.
        prim: of `--prim`.
        up: of `--up`.
        fps: of `--fps` [1/s].
        frames: of `--frames`.
        seconds: of `--seconds`, of simulated time.
        inflate: of `--inflate`, how much a skin is stretched.

    Raises:
        InputError: an option is not of the form that it has, or stands beside one that says the same.
    """

    def __init__(
        self,
        overrides: Iterable[str] | None,
        weld: bool = False,
        *,
        parts: str | None = None,
        unit: str | None = None,
        prim: str | None = None,
        up: str | None = None,
        fps: float | None = None,
        frames: int | None = None,
        seconds: float | None = None,
        inflate: float | None = None,
    ):
        if frames is not None and seconds is not None:
            raise InputError("--frames, --seconds: expected one of them")
        if seconds is not None and not 0.0 < seconds < 1e9:
            raise InputError(f"--seconds {seconds:g}: expected a time above 0")
        if unit not in (None, *METERS):
            raise InputError(f"--unit {unit}: expected {', '.join(METERS)}")
        self.overrides: list[Override] = []
        self._options: list[str] = []
        self._seconds = seconds
        for text in overrides or []:
            self._add(*parse_override(text))
        for option, path, value in (
            ("--weld", "balloon.weld", weld or None),
            (f"--parts {parts}", "balloon.taken", checked_parts(parts)),
            (f"--unit {unit}", "balloon.unit", unit),
            (f"--prim {prim}", "balloon.prim", prim),
            (f"--up {up}", "balloon.up", up),
            ("" if fps is None else f"--fps {fps:g}", "frames_per_second", fps),
            (f"--frames {frames}", "frames", frames),
            ("" if inflate is None else f"--inflate {inflate:g}", "balloon.inflation.stretch", inflate),
        ):
            if value is not None:
                self._add(path, value, option)

    def _add(self, path: str, value: object, option: str = "") -> None:
        self.overrides.append((path, value))
        self._options.append(option or f"--set {path}")

    def load(self, scene: str) -> Scene:
        """The scene of that name, changed.

        Raises:
            InputError: names the option whose value is wrong, else the scene.
        """
        with self._naming_options():
            loaded = load_scene(scene, self.overrides)
        if self._seconds is None:
            return loaded
        return override_scene(loaded, [("frames", max(1, round(self._seconds * loaded.frames_per_second)))])

    def balloon_of(self, mesh: Path) -> Balloon:
        """A mesh by itself as a balloon, changed; the mesh is not read.

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
