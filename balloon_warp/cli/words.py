"""How things are counted in what a user reads."""


def counted(count: int, noun: str) -> str:
    """Such as `1 frame` and `2,000 frames`."""
    return f"{count:,} {noun if count == 1 else f'{noun}s'}"
