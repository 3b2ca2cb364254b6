"""An audit as JSON: the findings unrounded."""

from __future__ import annotations

import json
from typing import Any

from lfobench.render.audit_text import Audit, verdict
from lfobench.stats.audit import AuditAtN, AuditedRow, MeansAudit
from lfobench.stats.audit_counts import AuditedCounts, CountsAudit
from lfobench.stats.audit_effects import MOST_SEEDS, POWER, Effect
from lfobench.stats.contradictions import Contradiction


def json_audit(audit: Audit) -> str:
    """One object: the verdict, a finding per table, the contradictions of the text.

    Numbers of samples are null where more than ``most_samples`` would be needed.
    """
    publication = audit.publication
    value = {
        "publication": publication.name,
        "paper": publication.paper,
        "verdict": verdict(audit),
        "power": POWER,
        "most_samples": MOST_SEEDS,
        "tables": [_means(table) if isinstance(table, MeansAudit) else _counts(table) for table in audit.tables],
        "stated_contradictions": [
            {"about": stated.about, "first": stated.first, "second": stated.second}
            for stated in publication.contradictions
        ],
    }
    return json.dumps(value, indent=2, allow_nan=False) + "\n"


def _means(audit: MeansAudit) -> dict[str, Any]:
    rule = audit.rule
    return {
        "table": audit.table.title,
        "kind": "means",
        "rule": {"test": rule.test, "correction": rule.correction, "alpha": rule.alpha},
        "compared": list(audit.compared),
        "claims_of_n": [{"n": claim.n, "where": claim.where} for claim in audit.table.claims],
        "n_that_give_every_highlight": list(audit.reproducing),
        "by_n": [_at_n(at_n) for at_n in audit.by_n],
        "effects": [
            {"row": row.name, **_effect(effect)} for row, effect in zip(audit.table.rows, audit.effects, strict=True)
        ],
        "contradictions": _contradictions(audit.contradictions),
    }


def _at_n(at_n: AuditAtN) -> dict[str, Any]:
    return {
        "n": at_n.n,
        "printed_highlights": len(at_n.judged),
        "follow": sum(bool(row.follows) for row in at_n.judged),
        "rows_tested": len(at_n.tested),
        "single_winners": len(at_n.winners),
        "lost_by_holm": [row.name for row in at_n.lost("holm")],
        "lost_by_bh": [row.name for row in at_n.lost("bh")],
        "not_decided_by_the_printed_numbers": [row.name for row in at_n.undecided_by_print],
        "rows": [
            {**_row(row), "p_range": row.p_range, "follows": row.follows, "by_the_rule": sorted(row.ruled)}
            for row in at_n.rows
        ],
    }


def _effect(effect: Effect | None) -> dict[str, Any]:
    if effect is None:
        return {"best": None, "second": None, "difference": None, "n_needed": None, "n_needed_by_holm": None}
    return {
        "best": effect.best,
        "second": effect.second,
        "difference": effect.difference,
        "n_needed": effect.needed,
        "n_needed_by_holm": effect.needed_by_holm,
    }


def _counts(audit: CountsAudit) -> dict[str, Any]:
    rule = audit.rule
    return {
        "table": audit.table.title,
        "kind": "counts",
        "rule": {"test": rule.test, "correction": rule.correction, "alpha": rule.alpha},
        "compared": list(audit.compared),
        "smallest_p": audit.closest.p if audit.closest else None,
        "merely_the_largest_count": [row.name for row in audit.rows if row.merely_largest],
        "rows": [
            {
                **_row(row),
                "best": sorted(row.best),
                "wilson_95": {method: [interval.low, interval.high] for method, interval in row.intervals.items()},
            }
            for row in audit.rows
        ],
        "contradictions": _contradictions(audit.contradictions),
    }


def _row(row: AuditedRow | AuditedCounts) -> dict[str, Any]:
    return {
        "row": row.name,
        "printed": None if row.printed is None else sorted(row.printed),
        "outcome": row.outcome,
        "p": row.p,
        "holm": row.holm,
        "bh": row.bh,
    }


def _contradictions(found: tuple[Contradiction, ...]) -> list[dict[str, str]]:
    return [{"where": each.where, "text": each.text} for each in found]
