"""One folder, one answer: table, report, figures, comparison, plan and Python take the same score and the same test."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_cli import InProcess
from helpers_folders import write_records
from helpers_records import endings, make_cell, make_counted
from matplotlib.collections import PathCollection
from scipy.stats import fisher_exact, ttest_ind

import lfobench
from lfobench.record import Evaluation, Record


def counting() -> list[Record]:
    """From the fixed starts BCO is far ahead in every seed, from all starts the two are level."""
    return [
        make_counted(endings(fixed, 10), endings(further, 100), method, seed, evaluations=5)
        for method, of_method, further in (("dilo", (2, 1, 2), 61), ("bco", (9, 10, 9), 50))
        for seed, fixed in enumerate(of_method)
    ]


def scoring() -> list[Record]:
    """Scores that differ clearly, the last evaluation the other way round."""
    return [
        record.model_copy(update={"evaluations": [*record.evaluations[:-1], last(record, 100.0 - score)]})
        for method, scores in (("dilo", (80.0, 84.0, 79.0)), ("bco", (20.0, 26.0, 21.0)))
        for record, score in zip(make_cell(scores, method), scores, strict=True)
    ]


def last(record: Record, score: float) -> Evaluation:
    return record.evaluations[-1].model_copy(update={"returns": [10.0 * score] * 2})


COUNTS = {
    # 5 of 30 and 183 of 300; 28 of 30 and 150 of 300.
    "test": "fisher",
    "p": float(fisher_exact([[188, 178], [142, 152]]).pvalue),
    "scores": {
        "dilo": [100.0 * (fixed + 61) / 110 for fixed in (2, 1, 2)],
        "bco": [100.0 * (fixed + 50) / 110 for fixed in (9, 10, 9)],
    },
    "verdict": "undecided",
}
FIVE = {
    "dilo": [(4 * each + 100.0 - each) / 5 for each in (80.0, 84.0, 79.0)],
    "bco": [(4 * each + 100.0 - each) / 5 for each in (20.0, 26.0, 21.0)],
}
SCORES = {
    "test": "welch",
    "p": float(ttest_ind(FIVE["dilo"], FIVE["bco"], equal_var=False).pvalue),
    "scores": FIVE,
    "verdict": "better",
}


@pytest.fixture(params=[(counting, COUNTS), (scoring, SCORES)], ids=["counts", "scores"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    make, expected = request.param
    return write_records(tmp_path / "runs", make()), expected


def test_every_view_gives_the_same_answer(
    folder: tuple[Path, dict[str, Any]], tmp_path: Path, lfobench_command: InProcess
) -> None:
    out, expected = folder
    scores, p = expected["scores"], pytest.approx(expected["p"])
    table = json.loads(lfobench_command("table", "--out", out, "--format", "json").out)
    (row,) = table["rows"]
    assert (table["rule"]["test"], row["outcome"], row["p"]) == (expected["test"], expected["verdict"], p)
    shown = {column["label"]: cell["scores"] for column, cell in zip(table["columns"], row["cells"], strict=True)}
    assert {name: shown[name] for name in scores} == {name: pytest.approx(of) for name, of in scores.items()}

    compared = json.loads(lfobench_command("compare", "dilo", "bco", "--out", out, "--json").out)
    (cell,) = compared["cells"]
    assert (compared["rule"]["test"], compared["statistic"]) == (expected["test"], table["statistic"])
    assert (cell["verdict"], cell["p"]) == (expected["verdict"], p)
    assert cell["subject"]["scores"] == pytest.approx(scores["dilo"])

    page = tmp_path / "report.html"
    assert lfobench_command("report", "--out", out, "--to", page).code == 0
    embedded = evidence(page.read_text(encoding="utf-8"))
    assert re.search(f'<option value="{expected["test"]}" selected', page.read_text(encoding="utf-8"))
    (pair,) = embedded["views"][f"{expected['test']} group none 0.05"]["pairs"]
    assert pair == ([1, 0, 0, 0] if expected["verdict"] == "better" else [0, 0, 1, 0])
    if expected["test"] == "welch":
        assert f"{np.mean(scores['dilo']):.1f}" in page.read_text(encoding="utf-8")
    verdict = "better than the second best: dilo on 1" if expected["verdict"] == "better" else "undecided on 1"
    assert verdict in page.read_text(encoding="utf-8")

    planned = json.loads(lfobench_command("power", "--out", out, "--json").out)
    means = {method["column"]: method["mean"] for method in planned["tasks"][0]["methods"]}
    assert means == {name: pytest.approx(np.mean(of)) for name, of in scores.items()}

    asked = lfobench.table(out)
    assert (asked.rule.test, asked.blocks[0].rows[0].p) == (expected["test"], p)
    assert evidence(lfobench.report(out)) == embedded
    drawn = lfobench.plot("scores", out)
    dots = [
        float(x) for each in drawn.axes[0].collections if isinstance(each, PathCollection) for x, _ in offsets(each)
    ]
    assert sorted(dots) == pytest.approx(sorted(score for of in scores.values() for score in of))


def evidence(page: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="views">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    value: dict[str, Any] = json.loads(found[1])
    return value


def offsets(dots: PathCollection) -> Any:
    return np.asarray(dots.get_offsets())


def test_learning_curves_rest_on_fewer_starts_and_say_so(tmp_path: Path, lfobench_command: InProcess) -> None:
    out = write_records(tmp_path / "runs", counting())
    drawn = lfobench.plot("curves", out)
    assert "fixed test starts" in drawn.caption and "final evaluation too" in drawn.caption
    assert "final evaluation too" in lfobench.report(out)
    plain = write_records(tmp_path / "plain", [make_counted(endings(4, 10), seed=seed) for seed in range(2)])
    for other in (lfobench.plot("curves", plain), lfobench.plot("curves", out, statistic="last5")):
        assert "alone" not in other.caption


@pytest.mark.slow
def test_a_statistic_or_a_test_of_scores_is_taken_by_every_view(tmp_path: Path, lfobench_command: InProcess) -> None:
    """`--test welch` compares the seeds' success rates, from all starts; `--stat last5` scores."""
    out = write_records(tmp_path / "runs", counting())
    rates, fixed = COUNTS["scores"], {"dilo": (2, 1, 2), "bco": (9, 10, 9)}
    for options, of in (
        (("--test", "welch"), rates),
        (("--stat", "last5"), {name: [100.0 * each / 50 for each in found] for name, found in fixed.items()}),
    ):
        p = pytest.approx(float(ttest_ind(of["dilo"], of["bco"], equal_var=False).pvalue))
        table = json.loads(lfobench_command("table", "--out", out, "--format", "json", *options).out)
        assert (table["rule"]["test"], table["rows"][0]["p"]) == ("welch", p)
        compared = json.loads(lfobench_command("compare", "dilo", "bco", "--out", out, "--json", *options).out)
        assert compared["cells"][0]["p"] == p
        page = tmp_path / "report.html"
        assert lfobench_command("report", "--out", out, "--to", page, *options).code == 0
        (pair,) = evidence(page.read_text(encoding="utf-8"))["views"]["welch group none 0.05"]["pairs"]
        assert sum(pair[:2]) == (table["rows"][0]["p"] < 0.05)
    assert "welch group none 0.05" in evidence(lfobench.report(out))["views"], "a knob"


# --- differences of rounding size ------------------------------------------------------------------------------------

FIVE_EVALUATIONS = (28.1, 29.3, 31.7, 30.9, 31.6)


def ordered(method: str, order: tuple[int, ...], shift: float = 0.0, **options: Any) -> list[Record]:
    """Three seeds with the same five evaluation scores, in this order."""
    return [
        record.model_copy(
            update={
                "evaluations": [
                    each.model_copy(update={"returns": [10.0 * (FIVE_EVALUATIONS[index] + shift)] * 2})
                    for each, index in zip(record.evaluations, order, strict=True)
                ]
            }
        )
        for record in make_cell([0.0] * 3, method, **options)
    ]


ORDERS = ((0, 1, 2, 3, 4), (0, 1, 2, 4, 3))


@pytest.mark.parametrize("shift", [0.0, 1e-9])
@pytest.mark.parametrize("test", ["welch", "student", "paired-t", "wilcoxon", "permutation", "mann-whitney"])
def test_the_same_scores_in_another_order_are_level(
    test: str, shift: float, tmp_path: Path, lfobench_command: InProcess
) -> None:
    """Sums in floating point differ by 7e-15 with the order of their terms."""
    assert sum(FIVE_EVALUATIONS) != sum(FIVE_EVALUATIONS[index] for index in ORDERS[1])
    both = [*ordered("dilo", ORDERS[0], shift), *ordered("bco", ORDERS[1])]
    out = write_records(tmp_path / "runs", both)
    (row,) = json.loads(lfobench_command("table", "--out", out, "--test", test, "--format", "json").out)["rows"]
    assert (row["outcome"], row["p"]) == ("undecided", 1.0)
    assert [cell["highlighted"] for cell in row["cells"]] == [True, True]
    compared = json.loads(lfobench_command("compare", "dilo", "bco", "--out", out, "--test", test, "--json").out)
    assert [(cell["verdict"], cell["p"], cell["difference"]) for cell in compared["cells"]] == [("undecided", 1.0, 0.0)]


@pytest.mark.parametrize("shift", [0.0, -1e-9])
@pytest.mark.parametrize("test", ["welch", "paired-t", "paired-permutation"])
def test_the_gate_does_not_close_for_rounding(
    test: str, shift: float, tmp_path: Path, lfobench_command: InProcess
) -> None:
    folders = [
        write_records(tmp_path / name, ordered("dilo", order, by))
        for name, order, by in (("before", ORDERS[0], 0.0), ("after", ORDERS[1], shift))
    ]
    outcome = lfobench_command("compare", *folders, "--test", test, "--correction", "none")
    assert outcome.code == 0
    assert "worse on 0 cells, undecided on 1" in outcome.out
    lower = write_records(tmp_path / "lower", ordered("dilo", ORDERS[1], -1.0))
    closed = lfobench_command("compare", folders[0], lower, "--test", "paired-t")
    assert closed.code == 1
    assert "rests on no estimate of spread" in " ".join(closed.out.split()), "p = 0 from constant differences"


def test_p_without_any_spread_is_said_to_be_a_limit(tmp_path: Path, lfobench_command: InProcess) -> None:
    out = write_records(tmp_path / "runs", [*ordered("dilo", ORDERS[0], 1.0), *ordered("bco", ORDERS[1])])
    table = json.loads(lfobench_command("table", "--out", out, "--format", "json").out)
    assert (table["rows"][0]["outcome"], table["rows"][0]["p"]) == ("better", 0.0)
    (note,) = [each["text"] for each in table["notes"] if each["label"] == "No spread"]
    assert note.startswith("every row:") and "p is a limit" in note
    mixed = json.loads(lfobench_command("table", "--out", out, "--format", "json", "--test", "permutation").out)
    assert not [each for each in mixed["notes"] if each["label"] == "No spread"]
    varied = write_records(tmp_path / "varied", [*make_cell([1.0, 2.0, 3.0]), *make_cell([1.0] * 3, "bco")])
    found = json.loads(lfobench_command("table", "--out", varied, "--format", "json").out)
    assert not [each for each in found["notes"] if each["label"] == "No spread"]
