"""The footnote: everything a reader must know to judge the numbers above it, generated from the records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from lfobench.contract.environment import ActionBox
from lfobench.contract.suite import GENERATED
from lfobench.record import Record, Tuning
from lfobench.score import SUCCESS_RATE
from lfobench.stats.contrast import scores_compared
from lfobench.stats.options import Correction, HighlightTest, Scope
from lfobench.stats.power import can_reach, smallest_p
from lfobench.stats.tests import PAIRED
from lfobench.tables.counting import (
    counts_successes,
    final_episodes,
    final_outcomes,
    fixed_outcomes,
    some_count_successes,
)
from lfobench.tables.table import DIVERGED, FAILED, HIGHLIGHT_NOTE, LOST, MISSING, Column, Note, Row, Table, competes
from lfobench.text import canonical_json, short_number

TESTS: dict[HighlightTest, str] = {
    "welch": "Welch's two-sided t-test",
    "student": "Student's two-sided t-test",
    "mann-whitney": "the two-sided Mann-Whitney test",
    "permutation": "the two-sided permutation test of the means",
    "paired-t": "the two-sided paired t-test",
    "wilcoxon": "Wilcoxon's two-sided signed-rank test",
    "paired-permutation": "the two-sided sign-flip test of the mean difference",
    "fisher": "Fisher's exact two-sided test of the pooled counts",
}

CORRECTIONS: dict[Correction, str] = {"none": "none", "holm": "Holm", "bh": "Benjamini-Hochberg"}

SCOPES: dict[Scope, str] = {"group": "the methods without expert actions", "all": "all methods"}


def highlight_notes(table: Table) -> Iterator[Note]:
    """The rule of the highlights: test, scope, level, correction; rows without a decision, and why."""
    rule, rows = table.rule, [row for _, row in table.rows()]
    tested = sum(row.p is not None for row in rows)
    corrected = f" corrected by {CORRECTIONS[rule.correction]} over the {tested} rows tested"
    text = (
        f"the best {'success rate' if table.counts else 'mean'} in its row among {SCOPES[rule.scope]}, "
        "and the second best too unless "
        f"{TESTS[rule.test]} between them gives p < {rule.alpha:g}"
        f"{'' if rule.correction == 'none' else corrected}. "
        f"Correction for multiple comparisons: {CORRECTIONS[rule.correction]}"
    )
    for outcome, sentence in (
        ("untested", f"Not tested for want of a second {unit(rule.test)}, both highlighted"),
        ("unopposed", "Nothing to compare, nothing highlighted"),
        ("all failed", "No success at all, nothing highlighted"),
    ):
        if concerned := [row for row in rows if row.outcome == outcome]:
            text += f". {sentence}: {_where(concerned, rows)}"
    if table.counts:
        text += ". Counts are tested because every record says how its episodes ended"
    yield Note(HIGHLIGHT_NOTE, f"{text}.")
    if rule.test in PAIRED:
        yield Note(
            "Pairs",
            "the test pairs the common start states, each with its mean over seeds. It generalises to other starts "
            "of these trained policies, not to other training seeds.",
        )
    if without := [row for row in rows if row.without_spread]:
        yield Note("No spread", without_spread_note(rule.test, _where(without, rows)))
    if any(cell is not None and cell.lost for _, _, cell in table.cells()):
        by = CORRECTIONS["holm" if rule.correction == "none" else rule.correction]
        yield Note(
            LOST, f"stands out with p < {rule.alpha:g}, and no longer when corrected by {by} over {tested} rows."
        )
    yield from _infeasible(table)


def unit(test: HighlightTest) -> str:
    """Unit of a test's sample size."""
    return "start state" if test in PAIRED else "episode" if test == "fisher" else "seed"


def without_spread_note(test: HighlightTest, where: str) -> str:
    """Explanation of a t-test's p where nothing varies."""
    alike = (
        "all pairs of start states have the same difference"
        if test in PAIRED
        else "the scores of neither method vary over seeds"
    )
    return (
        f"{where}: {alike}, so p is a limit, 0 where the means differ and 1 where they do not. It rests on no estimate "
        f"of spread: other {unit(test)}s may well differ."
    )


def _where(concerned: Sequence[Row], rows: Sequence[Row]) -> str:
    return "every row" if len(concerned) == len(rows) else ", ".join(row.task for row in concerned)


def _infeasible(table: Table) -> Iterator[Note]:
    """The design, where no result could have been significant: without this note it would read as "no difference"."""
    rule = table.rule
    tested = [_sizes(table, row) for _, row in table.rows() if row.p is not None]
    if any(can_reach(rule.test, *sizes, rule.alpha, len(tested), rule.correction) for sizes in tested):
        return
    found = [(p, max(sizes)) for sizes in tested if (p := smallest_p(rule.test, *sizes)) is not None]
    if found:
        smallest, most = min(found)
        times = f", times {len(tested)} under Holm" if rule.correction == "holm" and len(tested) > 1 else ""
        yield Note(
            "Design",
            f"with {most} {unit(rule.test)}s, {TESTS[rule.test]} gives at best p = {smallest:.2g}{times}, so no row "
            "could have come out significant. Use more, or another test.",
        )


def _sizes(table: Table, row: Row) -> tuple[int, int]:
    """The two largest samples that the row could have compared."""
    samples = [
        cell.sample
        for column, cell in zip(table.columns, row.cells, strict=True)
        if cell is not None and cell.sample is not None and competes(column, table.rule.scope)
    ]
    sizes = sorted(scores_compared(table.rule.test, sample) for sample in samples)
    return sizes[-1], sizes[-2]


Columns = Mapping[Column, Sequence[Record]]


def either(values: Iterable[Any]) -> str:
    """Distinct values in ascending order where they are numbers: ``300,000 or 500,000``."""
    distinct = list({canonical_json(value): value for value in values}.values())
    if all(isinstance(value, int) and not isinstance(value, bool) for value in distinct):
        return " or ".join(f"{value:,}" for value in sorted(distinct))
    return " or ".join(str(value) for value in distinct)


def grouped(pairs: Iterable[tuple[str, str]], between: str = ", ") -> str:
    """(text, name) pairs, each text once: alone if all names share it, else with its names: ``a (x, y), b (z)``."""
    concerned = _names_by_text(pairs)
    if len(concerned) == 1:
        return next(iter(concerned))
    return between.join(f"{text} ({', '.join(names)})" for text, names in concerned.items())


def mostly(pairs: Iterable[tuple[str, str]]) -> str:
    """(text, name) pairs: the text of most names, then the others with their names: ``a, but b (x, y)``."""
    concerned = _names_by_text(pairs)
    most = max(concerned, key=lambda text: len(concerned[text]))
    others = [f"{text} ({', '.join(names)})" for text, names in concerned.items() if text != most]
    return f"{most}, but {', '.join(others)}" if others else most


def per_column(columns: Columns, describe: Callable[[Record], Iterable[str]]) -> str:
    """Descriptions of the records, each with its columns where columns differ."""
    return grouped(
        (text, column.label) for column, records in columns.items() for record in records for text in describe(record)
    )


def assignments(fields: Iterable[Mapping[str, Any]]) -> list[str]:
    """``tau = 0.06`` per field, with all its values."""
    values: dict[str, list[Any]] = {}
    for one in fields:
        for name, value in one.items():
            values.setdefault(name, []).append(value)
    return [f"{name} = {either(found)}" for name, found in values.items()]


def _names_by_text(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    found: dict[str, dict[str, None]] = {}
    for text, name in pairs:
        found.setdefault(text, {})[name] = None
    return {text: list(names) for text, names in found.items()}


STATISTICS: dict[str, str] = {
    "last5": "mean of the last 5 evaluations",
    "last": "last evaluation",
    "best": "best evaluation, picked by the score it reports and therefore optimistic",
    "at": "evaluation at step {step:,}",
    "success": "percentage of successes among the episodes of its last policy, the final evaluation included",
}

_RETURN = "normalised return, 100 · (return − random) / (expert − random)"


def score_notes(table: Table, records: Sequence[Record]) -> Iterator[Note]:
    """Definition of a cell's number; where episodes are pooled, how far from independent they are."""
    if table.counts:
        yield _counts(records)
        yield _dependence(table)
    else:
        yield _scores(table, records)


def _scores(table: Table, records: Sequence[Record]) -> Note:
    statistic = table.statistic
    if statistic == SUCCESS_RATE:
        what = f"success rate in % of one episode of the last policy from each of {_starts(records)}"
        return Note("Score", f"{what}; mean ± sample standard deviation over seeds.{_why_scores(records)}")
    rates = "success rate in % of the episodes from the fixed test starts"
    what = rates if table.success_rates else f"{_RETURN}, where {_references(records)}"
    text = (
        f"{what}; mean ± sample standard deviation "
        f"over seeds. Each seed counts as the {STATISTICS[statistic.name].format(step=statistic.step)}"
    )
    fewest = min((len(record.evaluations) for record in records if record.status == "finished"), default=5)
    if statistic.name == "last5" and fewest < 5:
        text += f" (of all of them where a run has fewer; the shortest has {fewest})"
    return Note("Score", f"{text}.{_why_scores(records)}")


def _references(records: Sequence[Record]) -> str:
    """Returns that score 0 and 100."""
    returns = dict.fromkeys(
        f"{record.labels.row} {_number(environment['random_return'])} and {_number(environment['expert_return'])}"
        for record in records
        for environment in [record.identity["environment"]]
    )
    return f"random and expert are fixed references ({'; '.join(returns)}), not the demonstration of this table"


def _number(value: float) -> str:
    return short_number(value, ",.1f").removesuffix(".0")


def _why_scores(records: Sequence[Record]) -> str:
    if counts_successes(records):
        return (
            " Every record says how its episodes ended: without --stat and --test, lfobench table shows success counts "
            "instead, the final evaluation included."
        )
    if some_count_successes(records):
        return " Scores, not success counts, because some records do not say how their episodes ended."
    return ""


def _counts(records: Sequence[Record]) -> Note:
    return Note(
        "Score",
        "successes/episodes, and Wilson's 95% interval of the success rate in %. Pooled over seeds: each adds one "
        f"episode of its last policy from each of {_starts(records)}.",
    )


def _starts(records: Sequence[Record]) -> str:
    """``the 10 fixed test starts and 100 further ones (the final evaluation), the same for every method and seed``."""
    fixed = either(len(fixed_outcomes(record)) for record in records)
    further = [len(final_outcomes(record)) for record in records]
    beyond = (
        f" and {either(further)} further ones (the final evaluation), the same for every method and seed"
        if any(further)
        else ""
    )
    return f"the {fixed} fixed test starts{beyond}"


def _dependence(table: Table) -> Note:
    known = [
        (inflation, f"{column.label} on {row.task}")
        for row, column, cell in table.cells()
        if cell and cell.successes and (inflation := cell.successes.inflation) is not None
    ]
    what = "variance inflation by seeds (Rao and Scott 1992; 1 is none)"
    if known:
        largest, where = max(known)
        extent = f"Largest {what}: {largest:.1f}, {where}."
    else:
        extent = f"The {what} is unknown: it takes two seeds of a cell, successes and failures."
    return Note(
        "Episodes",
        "episodes of one seed share its policy and are not independent: where seeds differ, intervals and p-values "
        f"that pool episodes are too small. {extent} --test welch takes seeds as the unit.",
    )


def data_note(source: str, records: Sequence[Record]) -> Note:
    """The source, and what the offline and the expert data are."""
    recorded = [record for record in records if counts_trajectories(record)]
    mixed = [record for record in records if not counts_trajectories(record)]
    parts = [*([_mixed(mixed)] if mixed else []), *([_recorded(recorded)] if recorded else [])]
    origin = ", not read from published files" if source == GENERATED else _files(records)
    return Note("Source", f"{source}{origin}. {' '.join(parts)}")


def protocol_note(name: str, columns: Columns, records: Sequence[Record]) -> Note:
    """Steps, batches and evaluations."""
    protocols = [record.identity["protocol"] for record in records]
    steps, every, episodes = (
        either(protocol[field] for protocol in protocols)
        for field in ("steps", "evaluation_every", "evaluation_episodes")
    )
    assigned = any(protocol["steps_assigned"] for protocol in protocols)
    batches = per_column(
        columns,
        lambda record: (
            [f"batch size {record.identity['config']['batch_size']}"]
            if "batch_size" in record.identity["config"]
            else []
        ),
    )
    further = [final_episodes(record) for record in records]
    final = f"; after training, a final evaluation of {either(further)} episodes, likewise" if any(further) else ""
    return Note(
        "Protocol",
        f"{name}: {steps} gradient steps{' (set with --steps)' if assigned else ''}"
        f"{f', {batches}' if batches else ''}; every {every} steps an evaluation of {episodes} episodes, from the same "
        f"starts for every method and seed{final}.",
    )


def tuning_notes(columns: Columns) -> Iterator[Note]:
    """Grid, criterion and cost of the methods whose hyperparameters were tuned."""
    tuned = {column.label: _tuned(records) for column, records in columns.items()}
    searches = [f"{label}: {text}" for label, text in tuned.items() if text]
    if not searches:
        return
    untuned = [label for label, text in tuned.items() if not text]
    rest = f" Not tuned: {', '.join(untuned)}." if untuned else ""
    yield Note("Tuned", f"{'; '.join(searches)}. These runs and steps come on top of the table's.{rest}")


def counts_trajectories(record: Record) -> bool:
    """Whether a record's data is counted in recorded trajectories; else expert trajectories join the offline data."""
    return "offline_trajectories" in record.identity["recipe"]


def _files(records: Sequence[Record]) -> str:
    """Names of the files where all records were made of the same; a part without a file is generated."""
    named = [record.provenance.get("data_files") for record in records]
    if not all(files == named[0] for files in named) or not isinstance(named[0], dict):
        return ""
    files = {part: named[0].get(part) for part in ("offline", "expert")}
    names = (f"{part} {file.get('name') if isinstance(file, dict) else GENERATED}" for part, file in files.items())
    return f" ({', '.join(names)})"


def _mixed(records: Sequence[Record]) -> str:
    def values(field: str, of: Sequence[Record]) -> str:
        found = sorted({_there(record, field) for record in of})
        return " or ".join(f"{there:,}{_of_recipe(there, wanted)}" for there, wanted in found)

    def trajectories(count: str, whose: str = "") -> str:
        return f"{count} {whose}trajector{'y' if count == '1' else 'ies'}"

    joined = [record for record in records if sees_the_mix(record)]
    apart = dict.fromkeys(record.method for record in records if not sees_the_mix(record))
    mixed = trajectories(values("expert_trajectories", joined), "expert ") if joined else "no expert trajectory"
    none = f" (none for {', '.join(apart)}, as their authors have it)" if joined and apart else ""
    by_rows = [record for record in records if record.identity["recipe"].get("demonstration_rows") is not None]
    others = [record for record in records if record not in by_rows]
    shown = [
        *([f"{values('demonstration_rows', by_rows)} rows"] if by_rows else []),
        *([trajectories(values("demonstrations", others))] if others else []),
    ]
    return (
        f"Offline data: {values('offline_transitions', records)} transitions and, with their actions, {mixed}{none}."
        f"{_changed_ratio(records)} Expert data: {' or '.join(shown)}, observations only."
    )


def _changed_ratio(records: Sequence[Record]) -> str:
    """What the protocol's caps make of the ratio of the mix; empty where they leave it."""
    factors = [(f"{_expert_weight(record):.3g}", record.labels.group) for record in records]
    if {factor for factor, _ in factors} == {"1"}:
        return ""
    return f" The protocol's caps multiply the weight of expert trajectories in the recipe's mix by {grouped(factors)}."


def _expert_weight(record: Record) -> float:
    """Joining expert trajectories per offline transition, relative to the task's own recipe."""
    capped, whole = record.identity["recipe"], record.labels.uncapped
    if not whole or not capped["expert_trajectories"]:
        return 1.0
    kept: float = capped["offline_transitions"] / whole["offline_transitions"]
    joining: float = capped["expert_trajectories"] / whole["expert_trajectories"]
    return joining / kept


def sees_the_mix(record: Record) -> bool:
    """Whether the expert trajectories of its recipe were in the offline data of a record."""
    return bool(record.identity.get("expert_joins", True))


def _there(record: Record, field: str) -> tuple[int, int]:
    """Amount of a field in the data, and in the recipe."""
    wanted: int = record.identity["recipe"][field]
    return (wanted if record.counts is None else getattr(record.counts, field)), wanted


def _of_recipe(there: int, wanted: int) -> str:
    return f" of the recipe's {wanted:,}" if there < wanted else ""


def _recorded(records: Sequence[Record]) -> str:
    offline = grouped(((_offline(record.identity["recipe"]), record.labels.group) for record in records), "; ")
    expert = grouped(((_expert(record.identity["recipe"]), record.labels.group) for record in records), "; ")
    scaled = all(record.identity["recipe"].get("standardize") for record in records)
    units = " Observations are standardised by the offline data's moments for every method." if scaled else ""
    return f"Offline data: {offline}. Expert data, observations only: {expert}. No row crosses an end.{units}"


def _offline(recipe: dict[str, Any]) -> str:
    cut = ", cut to as many transitions as the expert part" if recipe.get("equal_transitions") else ""
    return f"{recipe['offline_trajectories']:,} {_trajectories(recipe.get('offline'))}{cut}"


def _expert(recipe: dict[str, Any]) -> str:
    trajectories = f"{recipe['expert_trajectories']:,} {_trajectories(recipe['expert'])}"
    actions = "" if recipe.get("expert_actions", True) else ", recorded without actions"
    if recipe["expert_transitions"] is None:
        return f"{trajectories}{actions}"
    return f"{recipe['expert_transitions']:,} transitions of {trajectories}, in random order{actions}"


def _trajectories(level: Any) -> str:
    return f"{level} trajectories" if level else "trajectories"


def _tuned(records: Sequence[Record]) -> str:
    """Empty where no record of a column carries a choice."""
    tunings = [(record.task, record.tuning) for record in records if record.tuning is not None]
    if not tunings:
        return ""
    # The seeds of one task share its choice, which was paid for once.
    paid = {(task, canonical_json(tuning.model_dump(mode="json"))): tuning for task, tuning in tunings}
    runs, steps = sum(tuning.runs for tuning in paid.values()), sum(tuning.steps for tuning in paid.values())
    tasks = dict.fromkeys(task for task, _ in tunings)
    untuned = [task for task in dict.fromkeys(record.task for record in records) if task not in tasks]
    rest = f"; not on {', '.join(untuned)}" if untuned else ""
    return (
        f"{grouped((_search(tuning), task) for task, tuning in tunings)}; chosen: "
        f"{mostly((', '.join(assignments([tuning.chosen])), task) for task, tuning in tunings)}; "
        f"{runs:,} runs, {steps:,} gradient steps{rest}"
    )


def _search(tuning: Tuning) -> str:
    grid = ", ".join(f"{field} from {', '.join(map(str, values))}" for field, values in tuning.grid.items())
    return f"{grid} by {tuning.criterion}"


def footnote(table: Table, columns: Columns) -> tuple[Note, ...]:
    """The notes of `table`, whose `columns` hold the given records."""
    records = [record for members in columns.values() for record in members]
    return (
        *score_notes(table, records),
        data_note(table.source, records),
        protocol_note(table.protocol, columns, records),
        _simulator(records),
        *_actions(records),
        *_precision(records),
        seeds_note(table),
        *highlight_notes(table),
        *_configurations(_layer(table.protocol, records), columns),
        *tuning_notes(columns),
        *_demonstration(table, records),
        *_diverged(table, columns),
        *_failed(table),
        *_missing(table),
        *_warnings(columns),
    )


def _simulator(records: Sequence[Record]) -> Note:
    versions: dict[str, list[str]] = {}
    for record in records:
        for package, version in record.identity["simulator"].items():
            versions.setdefault(package, []).append(str(version))
    environments = sorted({_environment(record.identity["environment"]) for record in records})
    packages = ", ".join(f"{package} {either(found)}" for package, found in versions.items())
    return Note("Simulator", f"{packages}; {', '.join(environments)}.")


def _actions(records: Sequence[Record]) -> Iterator[Note]:
    """Scaling of actions, for environments whose actions are not in [-1, 1]."""
    boxes = {
        f"{_environment(record.identity['environment'])} takes {ActionBox.from_identity(box).scaling}"
        for record in records
        if (box := record.identity.get("action_box"))
    }
    if boxes:
        yield Note("Actions", f"{'; '.join(sorted(boxes))}.")


def _environment(environment: Mapping[str, Any]) -> str:
    # An id may name the module that registers it before a colon.
    name = str(environment["id"]).rpartition(":")[2]
    arguments = ", ".join(assignments([environment.get("arguments", {})]))
    return f"{name} ({arguments})" if arguments else name


def _precision(records: Sequence[Record]) -> Iterator[Note]:
    """Precision of matrix products, where it was not float32, the default on a CPU."""
    devices = [record.provenance.get("device") for record in records]
    kinds = {str(device.get("precision", "float32")) if isinstance(device, dict) else "float32" for device in devices}
    if kinds != {"float32"}:
        yield Note("Precision", f"matrix products in {' and '.join(sorted(kinds))}.")


def seeds_note(table: Table) -> Note:
    """Number of seeds per cell, and their numbers."""
    cells = [(row, column, cell) for row, column, cell in table.cells() if cell is not None and column.run_here]
    sizes = [len(cell.seeds) for _, _, cell in cells]
    most, fewest = max(sizes), min(sizes)
    if fewest < most:
        short = ", ".join(
            f"{column.label} on {row.task} ({len(cell.seeds)})" for row, column, cell in cells if len(cell.seeds) < most
        )
        return Note("Seeds", f"n = {fewest} to {most} per cell, unequal. Fewer than {most}: {short}.")
    choices = {cell.seeds for _, _, cell in cells}
    which = f"seeds {', '.join(map(str, choices.pop()))}" if len(choices) == 1 else "different seeds per cell"
    untested = "" if table.rule.test in PAIRED else " and cannot be tested"
    spread = "" if most > 1 or table.counts else f"; one seed has no standard deviation{untested}"
    return Note("Seeds", f"n = {most} per cell ({which}){spread}.")


def _layer(protocol: str, records: Sequence[Record]) -> str:
    """Origin of changes to a method's configuration that are not the user's: the protocol, for some data the task."""
    by_task = any(counts_trajectories(record) or not sees_the_mix(record) for record in records)
    return f"protocol {protocol}{' or task' if by_task else ''}"


def _configurations(layer: str, columns: Columns) -> Iterator[Note]:
    presets = per_column(columns, lambda record: [str(record.identity["preset"])])
    yield Note("Presets", f"{presets}.")
    stated = [
        f"{column.label}: {', '.join(facts)}" for column, records in columns.items() if (facts := _stated(records))
    ]
    if stated:
        yield Note("Configured", f"{'; '.join(stated)}.")
    for label, field in ((f"Set by {layer}", "overrides"), ("Set by hand", "set")):
        settings = [
            f"{column.label}: {', '.join(_settings(records, field))}"
            for column, records in columns.items()
            if _settings(records, field)
        ]
        if settings:
            yield Note(label, f"{'; '.join(settings)}.")


def _settings(records: Sequence[Record], field: str) -> list[str]:
    return assignments(record.identity.get(field, {}) for record in records)


def _stated(records: Sequence[Record]) -> list[str]:
    """Fields of the configuration that the methods declare as stated in every footnote."""
    return assignments({name: record.identity["config"][name] for name in record.labels.stated} for record in records)


def _diverged(table: Table, columns: Columns) -> Iterator[Note]:
    runs = [
        f"{column.label} on {record.task}, seed {record.seed}"
        + (f" (step {record.diverged_at:,})" if record.diverged_at is not None else "")
        for column, records in columns.items()
        for record in records
        if record.status == "diverged"
    ]
    if runs:
        counted = "every episode of which counts as a failure" if table.counts else "counted as score 0"
        yield Note("Diverged", f"{DIVERGED}k marks k diverged seeds, {counted}: {'; '.join(runs)}.")


def _demonstration(table: Table, records: Sequence[Record]) -> Iterator[Note]:
    if not any(column.kind == "expert" for column in table.columns):
        return
    score = "success rate in %" if table.success_rates else "score"
    recorded = any(map(counts_trajectories, records))
    shown = f"mean {score} of the expert trajectories" if recorded else f"{score} of the expert trajectory"
    yield Note("Demonstration", f"the {shown} that the methods observe.")


def _failed(table: Table) -> Iterator[Note]:
    runs = [
        f"{column.label} on {row.task}, {'seed' if len(cell.failed_seeds) == 1 else 'seeds'} "
        f"{', '.join(map(str, cell.failed_seeds))}"
        for row, column, cell in table.cells()
        if cell is not None and cell.failed_seeds
    ]
    if runs:
        yield Note(
            "Failed",
            f"{FAILED}k marks k seeds that crashed and have no score; they are not in n: {'; '.join(runs)}. "
            "The command that made the table's records tries them again.",
        )


def _missing(table: Table) -> Iterator[Note]:
    missing = [
        f"{column.label} on {row.task}" for row, column, cell in table.cells() if cell is None and column.run_here
    ]
    if missing:
        yield Note("Missing", f"{MISSING} marks cells without any record: {', '.join(missing)}.")


def _warnings(columns: Columns) -> Iterator[Note]:
    concerned: dict[tuple[str, str], dict[str, None]] = {}
    for column, records in columns.items():
        for record in records:
            for warning in record.warnings:
                concerned.setdefault((warning.what, warning.remedy), {})[column.label] = None
    for (what, remedy), labels in concerned.items():
        yield Note("Warning", f"{what} {remedy} ({', '.join(labels)})")
