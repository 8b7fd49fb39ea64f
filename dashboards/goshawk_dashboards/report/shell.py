"""What every report's page has: one file that needs nothing else, in the reader's light or dark theme."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from importlib.resources import files

from goshawk_dashboards.report.canvas import DARK, LIGHT, Figure, css_variables, svg

_LIGHT = f"color-scheme: light dark; --page: #f4f6f7; --bad: #cc4a06; --good: #00806a; {css_variables(LIGHT)}"
_DARK = f"--page: #0d1012; --bad: #f5894a; --good: #3fc3a3; {css_variables(DARK)}"


def document(title: str, parts: Iterable[str]) -> str:
    """The whole page."""
    style = files("goshawk_dashboards.report").joinpath("page.css").read_text(encoding="utf-8")
    themes = f":root {{ {_LIGHT} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {_DARK} }} }}\n"
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{themes}{style}</style>\n</head>\n"
        "<body>\n<main>\n" + "\n".join(part for part in parts if part) + "\n</main>\n</body>\n</html>\n"
    )


def tiles(numbers: Iterable[tuple[str, str, str]], first: str = "") -> str:
    """Name, value and unit of each; `first` goes before them."""
    rest = "".join(
        f"<div class='tile'><b>{value} <small>{unit}</small></b><span>{escape(name)}</span></div>"
        for name, value, unit in numbers
    )
    return f"<div class='tiles'>{first}{rest}</div>"


def panel(figure: Figure, below: str = "", *, narrow: Figure | None = None) -> str:
    """A figure with its words; ``narrow`` is what a phone shows in its place, under another name."""
    phone = "" if narrow is None else f"<div class='narrow'>{svg(narrow)}</div>"
    return (
        f"<figure class='panel'><h2>{escape(figure.title)}</h2><figcaption>{escape(figure.caption)}</figcaption>"
        f"{svg(figure)}{phone}{below}</figure>"
    )


def table(heads: Iterable[str], rows: Iterable[Iterable[str]], kind: str = "") -> str:
    """A table of HTML that is escaped already."""
    head = "".join(f"<th class='number'>{name}</th>" for name in heads)
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in rows)
    return f"<table class='{kind}'><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
