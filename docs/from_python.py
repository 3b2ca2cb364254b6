"""From records to a table, a figure and a report, in Python: ``python docs/from_python.py FOLDER OUTPUT``."""

import sys
from pathlib import Path

import lfobench


def main(records: str, output: Path) -> None:
    """Everything that a paper needs of a folder of records."""
    frame = lfobench.load(records)
    finals = frame.groupby(["task", "method"])["score"].agg(["mean", "std", "count"])
    print(finals.round(1))

    episodes = lfobench.load(records, episodes=True)
    print(f"{len(frame)} evaluations, {len(episodes)} episodes")

    table = lfobench.table(records, test="welch", correction="holm")
    (output / "table.tex").write_text(lfobench.export(table, "latex"), encoding="utf-8")

    for kind in ("curves", "scores"):
        lfobench.plot(kind, records).savefig(output / f"{kind}.pdf")
    lfobench.report(records, to=output / "report.html")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
