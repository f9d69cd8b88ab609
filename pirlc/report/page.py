"""The page of a run: data to HTML, and both into the run's folder.

The page stands alone: styles and plots are in it, there is no script, and its policy forbids the
browser to fetch or run anything. Texts of the run (names, comments, the sketch) are data, which the
templates cannot put out otherwise than escaped.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from pirlc.backend.files import write_text
from pirlc.report import node
from pirlc.report.analysis_plots import plots as analysis_plots
from pirlc.report.page_data import page_data
from pirlc.report.page_plots import page_plots
from pirlc.report.problems import DamagedFile, error
from pirlc.report.run import ANALYSIS, PAGE, PAGE_DATA, VERIFICATION
from pirlc.report.stored import read_stored
from pirlc.resources import templates

if TYPE_CHECKING:
    from jinja2 import Environment


def write_report(folder: Path) -> tuple[Path, Path]:
    """Make the page of the run in a folder: `report.html`, and `report.json` with all it shows.

    Works on the folder alone, also where the run is unfinished; the same folder gives the same
    bytes. Raises PirlcError E0711, E0712, E0740, E0741.
    """
    data = page_data(read_stored(folder))
    text = _on_lines(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False))
    # The page is made of what the JSON says, not of what it was made from.
    page = page_text(json.loads(text))
    return write_text(folder / PAGE, page), write_text(folder / PAGE_DATA, text + "\n")


def _on_lines(text: str) -> str:
    """Indented JSON with each list of numbers on one line. No text holds a line end of its own."""
    return re.sub(r"\[\n[\s\d.,eE+-]+\]", lambda found: "".join(found[0].split()), text)


def page_text(data: Mapping[str, Any]) -> str:
    """The page that shows the data of `page_data`. Raises PirlcError E0741."""
    from jinja2 import UndefinedError

    template = _environment().get_template("report.html.j2")
    try:
        plots = {name: Markup(svg) for name, svg in page_plots(data).items()}
        margins = {} if data["analysis"] is None else analysis_plots(data["analysis"])
        drawn = [(f"/analysis{place}", Markup(svg)) for place, svg in margins.values()]
        return template.render(report=node.Node(data), plots=plots, analysis_plots=drawn)
    except (UndefinedError, TypeError, LookupError, ValueError) as e:
        files = f"{VERIFICATION}` or `{ANALYSIS}"
        raise error(DamagedFile(files, f"it is not as pirlc writes it ({e})")) from None


@lru_cache(maxsize=1)
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(templates("report")),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=True,
    )
    filters = (node.plain, node.pointer, node.coloured, node.key, node.evidence)
    environment.filters |= {filter_.__name__: filter_ for filter_ in filters}
    environment.filters["digits"] = node.shown
    environment.globals["style"] = Markup((templates("report") / "style.css").read_text("utf-8"))
    return environment
