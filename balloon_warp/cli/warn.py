"""Warnings and notes on a user's terminal."""

from rich.console import Console
from rich.markup import escape


def warn(sentence: str) -> None:
    """Print a warning on standard error, where no program reads results."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(f"[yellow]warning:[/] {escape(sentence)}")


def note(sentence: str) -> None:
    """Print what is good to know, where no program reads results."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(f"[cyan]note:[/] {escape(sentence)}")
