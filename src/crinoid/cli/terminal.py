"""Texts shown as they are: no text of a user's gives the terminal commands."""

from typing import Any

from rich.console import Console
from rich.text import Text

_SHOWN = {code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0)) if code != 0x0A}
"""Control characters, and what stands for them."""


class Terminal(Console):
    """A console that takes text literally: markup, emoji and control characters do nothing."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Turn text into what is shown."""
        return super().render_str(literal(text), **options)


def literal(text: str) -> str:
    """Return a text with its control characters, but for new lines, written out."""
    return text.translate(_SHOWN)
