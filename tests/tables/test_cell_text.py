from __future__ import annotations

import pytest

from lfobench.stats.intervals import Summary
from lfobench.stats.options import Agreement
from lfobench.stats.tests import Sample, sample_of
from lfobench.tables.table import Cell, CellText, cell_text


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        (Cell(sample_of([90.0, 91.0, 93.04])), "91.3 ± 1.5"),
        (Cell(sample_of([-0.04])), "0.0"),
        (Cell(sample_of([-8.96])), "-9.0"),
        (Cell(sample_of([50.0, 50.0])), "50.0 ± 0.0"),
        (Cell(sample_of([50.0, 50.0]), highlighted=True, lost=True), "50.0 ± 0.0†"),
        (Cell(sample_of([50.0, 0.0]), seeds=(0, 1), diverged_seeds=(1,)), "25.0 ± 35.4 ✗1"),
        (Cell(sample_of([50.0, 50.0]), seeds=(0, 1), failed_seeds=(2, 3)), "50.0 ± 0.0 !2"),
        (Cell(sample_of([50.0, 0.0]), diverged_seeds=(1,), failed_seeds=(2,), lost=True), "25.0 ± 35.4† ✗1 !1"),
        (Cell(None, failed_seeds=(0, 1, 2)), "crashed !3"),
        (Cell(Sample(Summary(5, 100.0, 2.0)), agreement="matches"), "100.0 ± 2.0 ≈"),
        (Cell(Sample(Summary(5, 100.0, None)), agreement="differs"), "100.0 ≠"),
    ],
    ids=str,
)
def test_every_mark_behind_its_number(cell: Cell, expected: str) -> None:
    assert str(cell_text(cell)) == expected


@pytest.mark.parametrize(("agreement", "sign"), [("matches", "≈"), ("differs", "≠"), ("undecided", "?")])
def test_agreements(agreement: Agreement, sign: str) -> None:
    assert cell_text(Cell(Sample(Summary(5, 1.0, 1.0)), agreement=agreement)).marks == sign


def test_the_highlight_is_the_exporters_business() -> None:
    plain = cell_text(Cell(sample_of([1.0, 2.0])))
    assert cell_text(Cell(sample_of([1.0, 2.0]), highlighted=True)) == plain == CellText("1.5", "0.7")
