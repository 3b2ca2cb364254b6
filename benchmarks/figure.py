"""The figure of docs/performance.md: ``python -m benchmarks.figure RESULTS.json OUT.svg`` draws it from raw values."""

from __future__ import annotations

import json
import statistics
import sys
from pathlib import Path
from typing import Any

BARS = (("authors", "authors' loop", "#b5b5b5"), ("engine", "engine", "#2c6fbb"))
FLOOR = "floor"


def draw(results: dict[str, Any], path: Path) -> None:
    """Every method's step over its matrix products alone: medians, whiskers from the least to the greatest ratio.

    Args:
        results: a file of `make bench`.
        path: where the picture goes; its ending chooses the format.
    """
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"font.size": 8, "svg.hashsalt": "lfobench"})
    from matplotlib import pyplot

    steps = results["steps"]
    figure, axes = pyplot.subplots(figsize=(6.3, 3.0), layout="constrained")
    height = 0.8 / len(BARS)
    for index, (name, label, colour) in enumerate(BARS):
        ratios = [_ratios(step, name) for step in steps]
        medians = [statistics.median(each) for each in ratios]
        below = [median - min(each) for median, each in zip(medians, ratios, strict=True)]
        above = [max(each) - median for median, each in zip(medians, ratios, strict=True)]
        places = [place + (index - 0.5) * height for place in range(len(steps))]
        axes.barh(places, medians, height, xerr=(below, above), label=label, color=colour, ecolor="#e08214")
    axes.axvline(1.0, color="#1b1b1b", linewidth=1, label="products alone")
    axes.set_yticks(range(len(steps)), [f"{step['workload']}, {step['batch_size']}" for step in steps])
    axes.invert_yaxis()
    axes.set_xlabel("time of a step over that of its matrix products alone")
    hardware = results["hardware"]
    axes.set_title(f"{hardware['name']}, {hardware['threads']} thread, {hardware['precision']}, one seed", fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def _ratios(step: dict[str, Any], name: str) -> list[float]:
    rounds: dict[str, list[float]] = {timing["name"]: timing["rounds"] for timing in step["timings"]}
    return [ours / floor for ours, floor in zip(rounds[name], rounds[FLOOR], strict=True)]


if __name__ == "__main__":
    draw(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2]))
