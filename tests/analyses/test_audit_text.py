"""An audit on a terminal, in Markdown and as JSON: the verdict first, three-valued words, nothing cut off."""

from __future__ import annotations

import io
import json

import pytest
from rich.console import Console

from lfobench.analyses.audit import Audit, document, json_audit, verdict
from lfobench.records.publication import (
    Claim,
    PrintedCount,
    PrintedMean,
    Publication,
    PublishedRow,
    StatedContradiction,
    TableOfCounts,
    TableOfMeans,
)
from lfobench.stats.audit import CountsRule, audit_counts, audit_means
from lfobench.stats.highlight import Rule


def cell(mean: float, std: float, highlighted: bool) -> PrintedMean:
    return PrintedMean(mean, std, 0.1, 0.1, None, highlighted)


MEANS = TableOfMeans(
    "Table 1",
    (
        PublishedRow({"task": "hopper-random"}, {"dilo": cell(90.0, 1.0, True), "bc|1": cell(20.0, 3.0, False)}),
        PublishedRow({"task": "ant-random"}, {"dilo": cell(50.0, 9.0, True), "bc|1": cell(49.0, 9.0, False)}),
        PublishedRow({"task": "walker2d-random"}, {"dilo": cell(20.0, 9.0, True), "bc|1": cell(6.5, 7.0, False)}),
    ),
    claims=(Claim(5, "the caption"), Claim(7, "the appendix")),
)
COUNTS = TableOfCounts(
    "Robot",
    (PublishedRow({"task": "reach"}, {"dilo": PrintedCount(9, 10, True), "bc": PrintedCount(4, 10, False)}),),
)
STATED = StatedContradiction("data", "400 trajectories in the text", "50 in the appendix")


def audited(*, claims: bool = True) -> Audit:
    means = MEANS if claims else TableOfMeans(MEANS.title, MEANS.rows)
    return Audit(
        Publication("paper-2024", "A Paper, v1", (means, COUNTS), (STATED,)),
        (audit_means(means, means.methods, Rule()), audit_counts(COUNTS, COUNTS.methods, CountsRule())),
    )


def printed(audit: Audit, width: int) -> str:
    file = io.StringIO()
    Console(file=file, width=width).print(document(audit))
    return file.getvalue()


def test_the_verdict_says_what_follows_and_what_does_not() -> None:
    assert verdict(audited()) == (
        "Table 1: with n = 5, 2 of 3 printed highlights follow, and Holm leaves 1 of 2 single winners; with n = 7, 2 "
        "of 3 printed highlights follow, and Holm leaves 2 of 2 single winners. Robot: no row has a better method by "
        "Fisher's exact test (smallest p 0.0573, reach); 1 of 1 highlighted rows mark merely the largest count. "
        "Contradictions: 1 in the numbers, 1 in the text as its transcriber states."
    )


def test_without_n_it_says_so_and_what_to_type() -> None:
    audit = audited(claims=False)
    assert "nothing was tested, because n is not stated (say it with --n)" in verdict(audit)
    assert "the rule gives every printed highlight for no n from 2 to 30" in verdict(audit)
    assert "n not stated" in printed(audit, 120)


def test_the_verdict_stands_above_the_rows() -> None:
    lines = printed(audited(), 200).splitlines()
    assert lines[0] == "A Paper, v1"
    assert lines[2].startswith("Table 1: with n = 5")
    first = next(line.split() for line in lines if "hopper-random " in line)
    assert first[:4] == ["hopper-random", "dilo", "better", "<0.0001"]
    text = "\n".join(lines)
    assert "not ant-random (dilo printed, bc|1, dilo by the rule)" in text
    assert "better, Holm undecided" in text
    assert "does not follow: undecided" in text
    assert "Contradiction" in text and "n is 5 by the caption and 7 by the appendix." in text
    assert "9/10 [0.60, 0.98]" in text
    assert "data: 400 trajectories in the text; 50 in the appendix." in text


@pytest.mark.parametrize("width", [80, 100, 120])
def test_it_keeps_to_the_width(width: int) -> None:
    assert max(map(len, printed(audited(), width).splitlines())) <= width


def test_no_bare_star_stands_for_a_verdict() -> None:
    assert "*" not in printed(audited(), 120)


def test_markdown_is_a_document_with_escaped_names() -> None:
    text = document(audited()).markdown()
    assert text.startswith("# Audit of paper-2024\n")
    assert text.index("Holm leaves 1 of 2") < text.index("## Table 1") < text.index("## Robot")
    rows = [line for line in text.splitlines() if line.startswith("| hopper-random")]
    assert len(rows) == 2
    assert "bc\\|1" in text
    assert "| reach | dilo | undecided | 0.0573 |" in text
    assert text.endswith("\n")


def test_json_holds_the_findings_unrounded() -> None:
    audit = audited()
    value = json.loads(json_audit(audit))
    means, counts = value["tables"]
    five = means["by_n"][0]
    assert (five["n"], five["follow"], five["printed_highlights"], five["single_winners"]) == (5, 2, 3, 2)
    assert five["lost_by_holm"] == ["walker2d-random"]
    assert five["rows"][1]["follows"] is False
    assert five["rows"][1]["by_the_rule"] == ["bc|1", "dilo"]
    assert means["effects"][0]["difference"] == 70.0
    assert means["claims_of_n"] == [{"n": 5, "where": "the caption"}, {"n": 7, "where": "the appendix"}]
    assert counts["smallest_p"] == audit.tables[1].rows[0].p  # type: ignore[union-attr]
    assert counts["merely_the_largest_count"] == ["reach"]
    assert value["stated_contradictions"][0]["about"] == "data"
    assert value["verdict"] == verdict(audit)


def test_what_the_printed_numbers_leave_open_is_said_with_its_range() -> None:
    cells = {"dilo": PrintedMean(50.0, 0.0, 1.0, 1.0, 3, True), "bc": PrintedMean(49.0, 0.0, 1.0, 1.0, 3, False)}
    of = TableOfMeans("T", (PublishedRow({"task": "hopper"}, cells),))
    audit = Audit(Publication("t", "", (of,), ()), (audit_means(of, of.methods, Rule()),))
    text = " ".join(printed(audit, 200).split())
    assert "1 row is not decided by the printed numbers: hopper" in text
    assert "± 0 may be up to ± 0.5, p up to 0.07" in text
    assert "better" not in text
    assert "1 not decided by the printed numbers" in verdict(audit)
    (found,) = json.loads(json_audit(audit))["tables"]
    assert found["by_n"][0]["not_decided_by_the_printed_numbers"] == ["hopper"]
    low, high = found["by_n"][0]["rows"][0]["p_range"]
    assert low == 0.0 and 0.07 < high < 0.08
