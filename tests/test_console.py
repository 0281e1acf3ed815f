"""Output to a terminal: names from files as text, whatever they are."""

import io

import pytest
from rich.table import Table

from balloon_warp.cli.console import Console, harmless


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("\x1b]0;title\x07.obj", "\\x1b]0;title\\x07.obj"),
        ("a\x9b31mb", "a\\x9b31mb"),
        ("a\u202eb", "a\\u202eb"),
        ("tab\tund \u00fcber", "tab\tund \u00fcber"),
    ],
)
def test_what_a_terminal_would_act_on_is_text(name: str, shown: str):
    assert harmless(name) == shown


def test_names_in_lines_and_tables_are_text_and_colors_stay():
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, color_system="standard", width=60, highlight=False)
    table = Table()
    table.add_row("\x1b]0;cell")
    console.print("[red]warning:[/] \x1b]0;line", table)
    text = file.getvalue()
    assert "\x1b]" not in text
    assert "\\x1b]0;line" in text
    assert text.count("\\x1b]0;") == 2
    assert "\x1b[31mwarning:" in text
