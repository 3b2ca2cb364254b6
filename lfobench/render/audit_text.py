"""An audit in words: the verdict, then per table what follows, row by row, and what contradicts itself."""

from __future__ import annotations

from dataclasses import dataclass

from lfobench.contract.publication import Publication
from lfobench.render.audit_counts import counts_in_short, report_counts
from lfobench.render.audit_means import means_in_short, report_means
from lfobench.render.audit_words import TableReport
from lfobench.stats.audit import MeansAudit
from lfobench.stats.audit_counts import CountsAudit


@dataclass(frozen=True)
class Audit:
    """What is rendered.

    Attributes:
        publication: what was audited.
        tables: one audit per table.
    """

    publication: Publication
    tables: tuple[MeansAudit | CountsAudit, ...]


def verdict(audit: Audit) -> str:
    """One paragraph: what follows from the numbers and what does not."""
    parts = [
        f"{table.table.title}: {means_in_short(table) if isinstance(table, MeansAudit) else counts_in_short(table)}"
        for table in audit.tables
    ]
    computed = sum(len(table.contradictions) for table in audit.tables)
    stated = len(audit.publication.contradictions)
    found = f"Contradictions: {computed} in the numbers"
    return " ".join([*parts, f"{found}, {stated} in the text as its transcriber states." if stated else f"{found}."])


def table_reports(audit: Audit) -> list[TableReport]:
    """Every table of the audit."""
    return [report_means(table) if isinstance(table, MeansAudit) else report_counts(table) for table in audit.tables]


def stated_contradictions(audit: Audit) -> list[str]:
    """What only the paper's prose shows; not computed."""
    return [f"{stated.about}: {stated.first}; {stated.second}." for stated in audit.publication.contradictions]
