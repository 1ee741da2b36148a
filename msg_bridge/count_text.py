"""Numbers of things in texts for people."""

__all__ = ["count_text"]


def count_text(count: int, noun: str) -> str:
    """Return a number with its noun, as `1 message` or `1,200 messages`.

    Args:
        count: the number.
        noun: in the singular; its plural ends with s.
    """
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
