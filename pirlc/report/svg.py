"""Plots as SVG that can stand inside HTML: no fonts, scripts or links of its own, names of its own
for what it defines, text as text, the same bytes for the same data.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 7.2
"""Inches: the width of the text on A4."""

_SETTINGS = {
    "svg.fonttype": "none",
    # Names come from the sketch: a `$` in them is no formula.
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.35,
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "axes.linewidth": 0.7,
    "legend.fontsize": 8,
    "legend.framealpha": 0.9,
}


@contextmanager
def drawing(name: str, height: float, width: float = WIDTH) -> Iterator[Figure]:
    """A figure, under settings that make its SVG depend on nothing but what is drawn."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    # Nobody's own settings of matplotlib play a part.
    own = {k: v for k, v in matplotlib.rcParamsDefault.items() if "backend" not in k}
    settings: dict[Any, Any] = {**own, **_SETTINGS, "svg.hashsalt": name}
    with matplotlib.rc_context(settings):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasSVG(figure)
        yield figure


def svg_of(figure: Figure, name: str, title: str) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return inline_svg(stream.getvalue().decode(), name, title)


def inline_svg(text: str, name: str, title: str) -> str:
    """An SVG file of matplotlib's as an element for HTML, with a title for those who cannot see it.

    Prolog, metadata and its style sheet (which would reach the whole page) are left out, and its
    ids get `name` in front, since ids are the page's.
    """
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>\s*", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r"url\(#", f"url(#{name}-", text)
    text = re.sub(r'href="#', f'href="#{name}-', text)
    text = re.sub(r"font: ([\d.]+px)[^;\"]*", r"font: \1 var(--sans)", text)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    label = f'role="img" aria-labelledby="{name}-title"'
    head = f'<title id="{name}-title">{escape(title)}</title>'
    return re.sub(
        r"<svg ([^>]*)>", lambda svg: f"<svg {label} {svg[1]}>\n{head}", text, count=1
    ).rstrip()
