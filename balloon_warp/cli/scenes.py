"""`balloon-warp scenes`"""

from rich.console import Console
from rich.table import Table

from balloon_warp.scene.load import bundled_scenes, load_scene


def scenes() -> None:
    """List the bundled scenes."""
    table = Table(box=None, pad_edge=False)
    table.add_column("scene", style="bold", no_wrap=True)
    table.add_column("what it shows")
    for name in bundled_scenes():
        table.add_row(name, load_scene(name).description)
    Console(highlight=False).print(table)
