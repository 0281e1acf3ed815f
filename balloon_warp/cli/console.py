"""The terminal, on which names from files do nothing but stand there."""

import re
from collections.abc import Iterable

from rich import console
from rich.console import ConsoleOptions, RenderableType
from rich.segment import Segment

ACTING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Control characters, but for tabs and ends of lines, and those that turn the direction of writing"""


def harmless(text: str) -> str:
    """Write characters that a terminal would act on as Python writes them, such as \\x1b."""
    return ACTING.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


class Console(console.Console):
    """Console of Rich that prints control characters, as of file names, as text."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=harmless(segment.text))
