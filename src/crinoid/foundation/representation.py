"""Representation of an object: a few lines of text, or a small table, with numbers and units."""

from abc import abstractmethod
from collections.abc import Iterable
from html import escape

_WIDTH = 100  # characters of a line of text


class Represented:
    """An object that shows itself by a title and rows, as text and in notebooks."""

    @abstractmethod
    def _representation(self) -> tuple[str, dict[str, str]]:
        """Return a title, and rows by their names; one without a text is left out."""

    def __repr__(self) -> str:
        title, rows = self._representation()
        kept = {name: text for name, text in rows.items() if text}
        wide = max(map(len, kept), default=0)
        return "\n".join([title, *(f"  {name:{wide}}  {text}" for name, text in kept.items())])

    __str__ = __repr__

    def _repr_html_(self) -> str:
        title, rows = self._representation()
        lines = (
            f'<tr><th scope="row">{escape(name)}</th><td>{escape(text)}</td></tr>'
            for name, text in rows.items()
            if text
        )
        return f"<p>{escape(title)}</p><table>{''.join(lines)}</table>"


def titled(kind: str, title: str, *more: str) -> str:
    """Return the first line of a representation, with the title of a scenario if it has one."""
    named = f'{kind} of "{title}"' if title else kind
    return f"{named}: {', '.join(more)}" if more else named


def cut_list(parts: Iterable[str]) -> str:
    """Return parts with commas between them, cut to a line with the count of those left out."""
    parts = list(parts)
    kept = parts
    while len(kept) > 1 and len(", ".join(kept)) > _WIDTH:
        kept = kept[:-1]
    left = len(parts) - len(kept)
    return ", ".join([*kept, *([f"... {left} more"] if left else [])])


def with_units(names: Iterable[str], units: Iterable[str], one: str = "") -> list[str]:
    """Return names, each with its unit, such as ``tilt (rad)``; ``one`` is in place of 1."""
    pairs = zip(names, (one if unit == "1" else unit for unit in units), strict=True)
    return [f"{name} ({unit})" if unit else name for name, unit in pairs]
