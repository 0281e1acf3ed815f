"""The panel: the controls that people reach for first, and everything else that can be set, in folders."""

from collections.abc import Callable
from typing import Any, get_args

import viser

from balloon_warp.scene import Scene
from balloon_warp.viewer.dials import Dial, on_change, on_slide
from balloon_warp.viewer.hands_on import HandsOn
from balloon_warp.viewer.layers import LAYERS, Layers
from balloon_warp.viewer.picture import Picture
from balloon_warp.viewer.playground import Playground
from balloon_warp.viewer.session import Session
from balloon_warp.viewer.sliders import VALUES, Value, does_something, of_tables, values_of
from balloon_warp.viewer.status import KEYS_BUTTON, details, row_of, status_line, strain_legend, trouble_line
from balloon_warp.viewer.touches import Touch

CHOICES = {
    field: {name.replace("_", " "): name for name in get_args(Scene.model_fields[field].annotation)}
    for field in ("solver", "normals", "correction", "contact")
}
"""Choices of scene fields by their labels in the panel"""


class Controls:
    """Adds the panel to a page.

    Args:
        server: of the page.
        session: that the panel steers.
        layers: of the view.
        look: turns a window's camera to the balloon, and lets it follow or stay.
        home: brings a window's camera back to where it was at first.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        session: Session,
        layers: Layers,
        look: Callable[[viser.ClientHandle], None],
        home: Callable[[viser.ClientHandle], None],
    ):
        self.server, self.session, self.layers = server, session, layers
        self._bound: tuple[int, int] = (0, 0)
        self._seen: Scene | None = None
        self._ways: dict[str, Any] = {}
        gui = server.gui
        gui.add_html(KEYS_BUTTON)
        self.status = gui.add_html("")
        self._add_trouble()
        self.hands_on = HandsOn(server, session, look, home)
        with gui.add_folder("Click"):
            self._add_click()
        self._folders: list[tuple[Any, list[Dial]]] = []
        self._add_dials("Balloon", [*VALUES, *values_of(session.laws)])
        for name, values in of_tables().items():
            self._add_dials(name, values)
        with gui.add_folder("Show", expand_by_default=False):
            self._add_layers()
        with gui.add_folder("Recording", expand_by_default=False):
            self._add_recording()
        with gui.add_folder("Plots", expand_by_default=False) as self.plots_folder:
            pass
        with gui.add_folder("Advanced", expand_by_default=False):
            self._add_advanced()
        self.details = gui.add_html("")

    def follow(self, picture: Picture, busy_seconds: float = 0.0) -> None:
        """Bring the panel up to date with a picture.

        Args:
            busy_seconds: how long a request takes by now, if it takes long.
        """
        if picture.granted == self.session.asked:  # else hands are ahead of the picture, and must not be pulled back
            if self._bound != (picture.load, picture.revision):
                self._bind(picture)
            if picture.scene is not self._seen:
                self._seen = picture.scene
                self._show_what_acts(picture.scene)
        self.hands_on.follow(picture)
        self.trouble.visible = self.back.visible = bool(picture.trouble)
        self.trouble.content = trouble_line(picture) if picture.trouble else ""
        self.record.label = "Stop and save" if picture.recorded_seconds is not None else "Record"
        self._offer_files()
        self.status.content, self.details.content = status_line(picture, busy_seconds), details(picture)

    def wait(self, picture: Picture, busy_seconds: float) -> None:
        """Report that a request takes some time."""
        self.status.content = status_line(picture, busy_seconds)

    def _add_trouble(self) -> None:
        self.trouble = self.server.gui.add_html("", visible=False)
        self.back = self.server.gui.add_button("Go back", visible=False, hint="to the shape shown")
        self.back.on_click(lambda _: self.session.go_back())

    def _add_click(self) -> None:
        gui = self.server.gui
        gui.add_markdown("Drag the balloon to pull it, or beside it to orbit the view.")
        self.tool = gui.add_dropdown("click", ("throws a sphere", "ties a string", "does nothing"))
        self.mass = self._plain_slider("mass [kg]", (0.1, 50.0, 0.1, 2.0), "of a sphere")
        self.cut = gui.add_button("Cut all strings", color="gray", hint="key C")
        self.cut.on_click(lambda _: self._cut())
        gui.add_command("Cut all strings", hotkey="C").on_trigger(lambda _: self._cut())

    def _plain_slider(self, label: str, numbers: tuple[float, float, float, float], hint: str) -> Any:
        """Return a slider that has no effect before a sphere is thrown; arguments are from, to, step and start."""
        slider = self.server.gui.add_slider(label, *numbers, hint=hint)
        on_slide(slider, lambda _: None, self.session.tell)
        return slider

    def _add_dials(self, name: str, values: list[Value]) -> None:
        """Add a folder of sliders; those without effect in a scene are hidden."""
        gui = self.server.gui
        with gui.add_folder(name, expand_by_default=False) as folder:
            dials = [self._dial(value) for value in values]
            if name == "Balloon":
                hint = "pushes balloons that have drag in air"
                self.wind = gui.add_vector3("wind [m/s]", (0.0, 0.0, 0.0), step=0.1, hint=hint)
                on_change(self.wind, self._blow)
        self._folders.append((folder, dials))

    def _dial(self, value: Value) -> Dial:
        return Dial(self.server.gui, value, lambda number: self.session.set(value.path, number), self.session.tell)

    def _show_what_acts(self, scene: Scene) -> None:
        for folder, dials in self._folders:
            for dial in dials:
                dial.visible = does_something(scene, dial.value.row)
            visible = any(dial.visible for dial in dials)
            if folder.visible != visible:
                folder.visible = visible
        self.shown["contacts"].visible = scene.contacts

    def _add_layers(self) -> None:
        self.shown = {}
        for name, label in LAYERS.items():
            box = self.server.gui.add_checkbox(label, self.layers.shown[name])
            on_change(box, lambda shown, name=name: self._show(name, bool(shown)))
            self.shown[name] = box
            if name == "strain":
                self.legend = self.server.gui.add_html(strain_legend(), visible=False)

    def _add_recording(self) -> None:
        gui = self.server.gui
        gui.add_markdown("Saves an animated stage (USD), and a scene that replays it from its start.")
        self.record = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD)
        self.record.on_click(lambda _: self.session.record(self.session.recording is None))
        self._offered: list[tuple[Any, int]] = []
        gui.add_html(row_of(2))
        for label, number in (("Stage", 0), ("Scene", 1)):
            button = gui.add_button(
                label, icon=viser.Icon.DOWNLOAD, color="gray", visible=False, hint="download the last recording"
            )
            button.on_click(lambda event, number=number: event.client and self._send(event.client, number))
            self._offered.append((button, number))

    def _offer_files(self) -> None:
        for button, number in self._offered:
            if button.visible != (number < len(self.session.saved)):
                button.visible = not button.visible

    def _send(self, client: viser.ClientHandle, number: int) -> None:
        """Send a file of the last recording to a window, whose browser saves it."""
        file = self.session.saved[number]
        try:
            content = file.read_bytes()
        except OSError as error:
            return self.session.tell(f"{file}: cannot be read: {error.strerror}")
        client.send_file_download(file.name, content, save_immediately=True)

    def _add_advanced(self) -> None:
        gui = self.server.gui
        for field, choices in CHOICES.items():
            way = gui.add_dropdown(field, tuple(choices))
            on_change(way, lambda name, field=field: self.session.set_method(field, CHOICES[field][name]))
            self._ways[field] = way
        self.stable = gui.add_checkbox("keep the step stable", True)
        on_change(self.stable, self._keep_stable)
        sizes = "of a thrown sphere, in sizes of the balloon"
        self.radius = self._plain_slider("radius [size]", (0.02, 0.5, 0.01, 0.12), sizes)
        self.throw_speed = self._plain_slider("speed [sizes/s]", (0.5, 30.0, 0.5, 5.0), sizes)

    def _show(self, name: str, shown: bool) -> None:
        self.layers.show(name, shown)
        self.legend.visible = self.layers.shown["strain"]
        self.session.wants_forces = self.layers.shown["forces"]

    def _cut(self) -> None:
        self.session.ask(lambda playground: playground.cut_all(), key="cut", touch=Touch.CUTS)

    def _blow(self, wind: Any) -> None:
        self.session.ask(
            lambda playground: playground.blow([float(part) for part in wind]), key="wind", touch=Touch.BLOWS
        )

    def _keep_stable(self, keep: Any) -> None:
        def change(playground: Playground) -> None:
            playground.keep_stable = bool(keep)

        self.session.ask(change, key="stable")

    def _bind(self, picture: Picture) -> None:
        """Set values and ranges to the scene's current ones."""
        scene, fresh = picture.scene, self._bound[0] != picture.load
        self.hands_on.bind(picture, fresh)
        for _, dials in self._folders:
            for dial in dials:
                number = dial.value.read(scene)
                if fresh:
                    dial.reach(number)
                dial.put(number)
        self.wind.value = scene.atmosphere.wind
        for field, choices in CHOICES.items():
            names = {choice: name for name, choice in choices.items()}
            self._ways[field].value = names[getattr(scene, field)]
        self._bound = (picture.load, picture.revision)
