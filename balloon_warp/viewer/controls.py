"""The panel: everything that can be set, in folders."""

import math
from collections.abc import Callable
from typing import Any, get_args

import viser

from balloon_warp.errors import InputError
from balloon_warp.scene import Scene, bundled_scenes, load_scene
from balloon_warp.viewer.layers import LAYERS, Layers
from balloon_warp.viewer.picture import Picture
from balloon_warp.viewer.playground import Playground
from balloon_warp.viewer.session import Session
from balloon_warp.viewer.sliders import VALUES, WIDER, Value, of_tables, stands_in, values_of
from balloon_warp.viewer.status import KEYS_BUTTON, details, status_line, strain_legend, trouble_line

SPEEDS = ("0.1", "0.25", "0.5", "1", "2")
NUDGE = 0.04
"""part of the inflation slider that a key moves it by"""
INFLATIONS = {"k_normal": "inflation (k_normal)", "pressure": "pressure [Pa]", "pump": "pump [mol/s]"}


CHOICES = {
    field: {name.replace("_", " "): name for name in get_args(Scene.model_fields[field].annotation)}
    for field in ("solver", "normals", "correction", "contact")
}
"""of the scene, by what they are called in the panel"""


class Controls:
    """Adds the panel to a page.

    Args:
        server: of the page.
        session: what is played.
        layers: what is drawn.
        look: turns a window's camera to the balloon, and lets it follow or stay.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        layers: Layers,
        look: Callable[[viser.ClientHandle], None],
    ):
        self.server, self.session, self.layers = server, session, layers
        self._bound: tuple[int, int] = (0, 0)
        self._values: list[tuple[Value, Any]] = []
        self._ways: dict[str, Any] = {}
        gui = server.gui
        gui.add_html(KEYS_BUTTON)
        self.status = gui.add_html("")
        self._add_time(look)
        self._add_trouble()
        self._add_inflation()
        with gui.add_folder("Click"):
            self._add_click()
        with gui.add_folder("Balloon", expand_by_default=False):
            self._add_balloon()
        self._add_tables()
        with gui.add_folder("Show", expand_by_default=False):
            self._add_layers()
        with gui.add_folder("Recording", expand_by_default=False):
            self._add_recording()
        with gui.add_folder("Plots", expand_by_default=False) as self.plots_folder:
            pass
        self.details = gui.add_html("")

    def follow(self, picture: Picture) -> None:
        """Bring the panel up to date with a picture."""
        if picture.granted == self.session.asked:  # else hands are ahead of what is shown, and must not be pulled back
            if self._bound != (picture.load, picture.revision):
                self._bind(picture)
            elif self._inflation_moved(picture):
                _put(self.inflation, picture.inflation)  # a scene that inflates by itself, or a key
        self.run.label = "Pause" if picture.running else "Run"
        self.trouble.visible = self.back.visible = bool(picture.trouble)
        self.trouble.content = trouble_line(picture) if picture.trouble else ""
        self.record.label = "Stop and save" if picture.recorded_seconds is not None else "Record"
        self.status.content, self.details.content = status_line(picture), details(picture)

    def wait(self, picture: Picture, busy_seconds: float) -> None:
        """Say that what was asked for takes some time."""
        self.status.content = status_line(picture, busy_seconds)

    def _inflation_moved(self, picture: Picture) -> bool:
        slider = self.inflation
        return abs(slider.value - picture.inflation) > 1e-3 * (slider.max - slider.min)

    def _add_trouble(self) -> None:
        self.trouble = self.server.gui.add_html("", visible=False)
        self.back = self.server.gui.add_button("Go back", visible=False, hint="to the shape that is seen")
        self.back.on_click(lambda _: self.session.go_back())

    def _add_time(self, look: Callable[[viser.ClientHandle], None]) -> None:
        gui, session = self.server.gui, self.session
        self.scenes = gui.add_dropdown("scene", tuple(dict.fromkeys([session.name, *bundled_scenes()])))
        self._given = {session.name: session.scene}
        self.run = gui.add_button("Pause", hint="space")
        self.step = gui.add_button("Step one frame", color="gray", hint="key N")
        self.reset = gui.add_button("Reset", color="gray", hint="key R")
        self.look = gui.add_button("Follow the balloon", color="gray", hint="key F; again, the camera stays")
        self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        self.run.on_click(lambda _: self._toggle_run())
        self.step.on_click(lambda _: session.step_once())
        self.reset.on_click(lambda _: session.reset())
        self.look.on_click(lambda event: event.client and look(event.client))
        _on_change(self.speed, lambda value: session.set_speed(float(value)))
        _on_change(self.scenes, self._load)
        self._key("Pause or run", "space", self._toggle_run)
        self._key("Step one frame", "N", session.step_once)
        self._key("Reset", "R", session.reset)
        command = gui.add_command("Follow the balloon", hotkey="F")
        command.on_trigger(lambda event: event.client and look(event.client))

    def _add_inflation(self) -> None:
        self.inflation = self.server.gui.add_slider("inflation", 0.0, 1.0, 0.001, 0.0, hint="keys ↑ and ↓")
        _on_change(self.inflation, self._inflate)
        self._key("Inflate", "arrowup", lambda: self._nudge(NUDGE))
        self._key("Deflate", "arrowdown", lambda: self._nudge(-NUDGE))

    def _add_click(self) -> None:
        gui = self.server.gui
        gui.add_markdown("Drag the balloon to pull it, drag beside it to look around. A click does this:")
        self.tool = gui.add_dropdown("a click", ("throws a sphere", "ties a string", "does nothing"))
        self.radius = gui.add_slider("radius [size]", 0.02, 0.5, 0.01, 0.12, hint="of the balloon's size")
        self.mass = gui.add_slider("mass [kg]", 0.1, 50.0, 0.1, 2.0)
        self.throw_speed = gui.add_slider("speed [sizes/s]", 0.5, 30.0, 0.5, 5.0)
        self.cut = gui.add_button("Cut all strings", color="gray", hint="key C")
        self.cut.on_click(lambda _: self._cut())
        self._key("Cut all strings", "C", self._cut)

    def _add_balloon(self) -> None:
        gui = self.server.gui
        for value in (*VALUES, *values_of(self.session.laws)):
            self._add_slider(value)
        self.wind = gui.add_vector3(
            "wind [m/s]", (0.0, 0.0, 0.0), step=0.1, hint="pushes balloons that have drag in air"
        )
        _on_change(self.wind, self._blow)
        for field, choices in CHOICES.items():
            way = gui.add_dropdown(field, tuple(choices))
            _on_change(way, lambda name, field=field: self.session.set(field, CHOICES[field][name]))
            self._ways[field] = way
        self.stable = gui.add_checkbox("as many substeps as stability asks", True)
        _on_change(self.stable, self._keep_stable)

    def _add_slider(self, value: Value) -> Any:
        slider = self.server.gui.add_slider(value.label, 0.0, 1.0, 0.001, 0.0, hint=value.row.meaning or None)
        _on_change(slider, lambda number: self.session.set(value.path, number))
        self._values.append((value, slider))
        return slider

    def _add_tables(self) -> None:
        """Folders for what only some scenes have; those that this one lacks are not seen."""
        self._tables = []
        for name, values in of_tables().items():
            with self.server.gui.add_folder(name, expand_by_default=False, visible=False) as folder:
                self._tables.append((folder, [(value, self._add_slider(value)) for value in values]))

    def _show_tables(self, scene: Scene) -> None:
        for folder, values in self._tables:
            for value, slider in values:
                slider.visible = stands_in(scene, value.row)
            folder.visible = any(slider.visible for _, slider in values)

    def _add_layers(self) -> None:
        self.shown = {}
        for name, label in LAYERS.items():
            box = self.server.gui.add_checkbox(label, self.layers.shown[name])
            _on_change(box, lambda shown, name=name: self._show(name, bool(shown)))
            self.shown[name] = box
            if name == "strain":
                self.legend = self.server.gui.add_html(strain_legend(), visible=False)

    def _add_recording(self) -> None:
        gui = self.server.gui
        gui.add_markdown("Saves an animated stage (USD), and a scene that replays it from its start.")
        self.record = gui.add_button("Record")
        self.record.on_click(lambda _: self.session.record(self.session.recording is None))

    def _key(self, label: str, key: Any, act: Callable[[], None]) -> None:
        self.server.gui.add_command(label, hotkey=key).on_trigger(lambda event: act())

    def _toggle_run(self) -> None:
        self.session.run(not self.session.running)

    def _show(self, name: str, shown: bool) -> None:
        self.layers.show(name, shown)
        self.legend.visible = self.layers.shown["strain"]
        self.session.wants_forces = self.layers.shown["forces"]

    def _inflate(self, value: float) -> None:
        self.session.ask(lambda playground: playground.inflate(float(value)), key="inflate")

    def _nudge(self, part: float) -> None:
        slider = self.inflation

        def nudge(playground: Playground) -> None:  # from where it is: the slider may not have followed yet
            value = playground.inflation + part * (slider.max - slider.min)
            playground.inflate(min(max(value, slider.min), slider.max))

        self.session.ask(nudge)

    def _cut(self) -> None:
        self.session.ask(lambda playground: playground.cut_all(), key="cut")

    def _blow(self, wind: Any) -> None:
        self.session.ask(lambda playground: playground.blow([float(part) for part in wind]), key="wind")

    def _keep_stable(self, keep: Any) -> None:
        def change(playground: Playground) -> None:
            playground.keep_stable = bool(keep)

        self.session.ask(change, key="stable")

    def _load(self, name: str) -> None:
        def find() -> Scene:
            if name not in self._given and name not in bundled_scenes():
                raise InputError(f"{str(name)[:60]}: no such scene")
            return self._given.get(name) or load_scene(name)

        self.session.load(str(name), find)

    def _bind(self, picture: Picture) -> None:
        """Values and ranges as the scene has them now."""
        scene, fresh = picture.scene, self._bound[0] != picture.load
        if fresh:
            inflation = scene.balloon[0].inflation
            self.inflation.label = INFLATIONS[inflation.keyframed]
            most = max(max(abs(value) for _, value in inflation.keyframes) * 2.0, 1e-3)
            _range(self.inflation, most, signed=inflation.keyframed == "pump")
            for value, slider in self._values:
                most = max(WIDER * abs(value.read(scene)), value.least_reach)
                _range(slider, min(most, value.row.most), value.signed)
        _put(self.inflation, picture.inflation)
        for value, slider in self._values:
            _put(slider, value.read(scene))
        self._show_tables(scene)
        _put(self.wind, scene.atmosphere.wind)
        for field, choices in CHOICES.items():
            names = {choice: name for name, choice in choices.items()}
            _put(self._ways[field], names[getattr(scene, field)])
        _put(self.scenes, picture.name)
        self._bound = (picture.load, picture.revision)


def _on_change(handle: Any, act: Callable[[Any], None]) -> None:
    """Act on what somebody sets in a page, not on what we put there. At once, on the thread that heard it: later there
    might be another value, that we put there."""

    @handle.on_update
    async def _(event: Any) -> None:
        if event.client is not None:
            act(handle.value)


def _put(handle: Any, value: Any) -> None:
    if hasattr(handle, "max") and not isinstance(value, tuple):
        value = min(max(float(f"{value:.4g}"), handle.min), handle.max)  # as many digits as the field shows
    handle.value = value


def _range(slider: Any, most: float, signed: bool) -> None:
    """From 0, or as far below it, up to a value with two digits."""
    digit = 10.0 ** (math.floor(math.log10(most)) - 1)
    most = float(f"{math.ceil(most / digit - 1e-9) * digit:.2g}")
    slider.min, slider.max = -most if signed else 0.0, most
    slider.step = (slider.max - slider.min) / 1000.0
