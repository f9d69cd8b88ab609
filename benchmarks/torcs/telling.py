"""Results as data and as Markdown."""

from __future__ import annotations

import argparse
import io
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.torcs import paper
from benchmarks.torcs.drivers import ORACLES, ROOT, SYNTHESISED
from benchmarks.torcs.racing import LAPS
from pirlc.backend.files import write_bytes, write_text
from pirlc.simulation.torcs.protocol import Status
from pirlc.simulation.torcs.summary import RaceSummary, outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESULTS = ROOT / "benchmarks" / "results" / "torcs"


def parser_of(prog: str, description: str | None) -> argparse.ArgumentParser:
    """A parser of what every experiment can be told."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {prog}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--output", type=Path, default=RESULTS, help="folder of the results")
    return parser


def racing_parser(prog: str, description: str | None) -> argparse.ArgumentParser:
    """The same for experiments that race programs and oracles."""
    parser = parser_of(prog, description)
    parser.add_argument("--programs", type=Path, default=SYNTHESISED, help="synthesised programs")
    parser.add_argument("--oracles", type=Path, default=ORACLES, help="folder of oracles")
    parser.add_argument("--laps", type=int, default=LAPS, help="of a race")
    return parser


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """In Markdown; all but the first column are to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def tell(name: str, text: str, data: object, folder: Path) -> None:
    """Prints the text, and writes it and the data under a name."""
    print(text)
    write_text(folder / f"{name}.md", text.rstrip("\n") + "\n")
    write_text(folder / f"{name}.json", json.dumps(plain(data), indent=1) + "\n")


def plain(data: object) -> Any:
    """Without NaN, for which JSON has no words, and without more digits than are meant."""
    match data:
        case float():
            return float(f"{data:.6g}") if math.isfinite(data) else None
        case dict():
            return {str(key): plain(value) for key, value in data.items()}
        case list() | tuple():
            return [plain(value) for value in data]
        case _:
            return data


def save(figure: Figure, to: Path) -> Path:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    image = io.BytesIO()
    # No date in the file: the same data gives the same bytes.
    figure.savefig(image, format="png", dpi=130, metadata={"Software": None})
    return write_bytes(to, image.getvalue())


def number(value: float, digits: int) -> str:
    return f"{value:,.{digits}f}" if math.isfinite(value) else "-"


def ending(figures: RaceSummary) -> str:
    """`-` for a race that was finished, else how it ended."""
    return "-" if figures.status is Status.FINISHED else outcome(figures)


def nodes(counts: dict[str, int]) -> str:
    return " + ".join(map(str, counts.values())) or "-"


def laps(figures: RaceSummary) -> str:
    return " ".join(f"{lap:.2f}" for lap in figures.laps) or "-"


def of_paper(found: paper.Lap | paper.Crash | None) -> tuple[str, str]:
    """Lap time and reward."""
    match found:
        case paper.Lap(time, reward):
            return f"{time:.2f}", f"{reward:.2f}"
        case paper.Crash(distance):
            return f"crashed after {distance:,.0f} m", "-"
        case None:
            return "-", "-"


def as_data(figures: RaceSummary) -> dict[str, object]:
    return {
        "outcome": outcome(figures),
        "laps": figures.laps,
        "mean_lap": figures.mean_lap,
        "mean_reward": figures.mean_reward,
        "distance": figures.distance,
        "damage": figures.damage,
        "largest_position": figures.largest_position,
        "steering_deviation": figures.steering_deviation,
        "top_speed": figures.top_speed,
    }
