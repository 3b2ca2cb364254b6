"""The part of the footnote that says what the methods were trained on, for how long, and how they were tuned."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from lfobench.contract.files import GENERATED
from lfobench.contract.record import Record, Tuning, canonical_json
from lfobench.render.counting import further_episodes
from lfobench.render.table import Note
from lfobench.render.wording import Columns, assignments, either, mostly, per_column, with_whom


def data_note(source: str, records: Sequence[Record]) -> Note:
    """The source, and what the offline and the expert data are."""
    recorded = [record for record in records if counts_trajectories(record)]
    mixed = [record for record in records if not counts_trajectories(record)]
    said = [*([_mixed(mixed)] if mixed else []), *([_recorded(recorded)] if recorded else [])]
    origin = ", not read from published files" if source == GENERATED else _files(records)
    return Note("Source", f"{source}{origin}. {' '.join(said)}")


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
    further = [further_episodes(record) for record in records]
    once = f"; after training, {either(further)} episodes from further starts, likewise" if any(further) else ""
    return Note(
        "Protocol",
        f"{name}: {steps} gradient steps{' (set with --steps)' if assigned else ''}"
        f"{f', {batches}' if batches else ''}; every {every} steps an evaluation of {episodes} episodes, from the same "
        f"starts for every method and seed{once}.",
    )


def tuning_notes(columns: Columns) -> Iterator[Note]:
    """Of the methods whose hyperparameters were chosen from a grid: which grid, by what, at what cost."""
    tuned = {column.label: _tuned(records) for column, records in columns.items()}
    said = [f"{label}: {text}" for label, text in tuned.items() if text]
    if not said:
        return
    untuned = [label for label, text in tuned.items() if not text]
    rest = f" Not tuned: {', '.join(untuned)}." if untuned else ""
    yield Note("Tuned", f"{'; '.join(said)}. These runs and steps come on top of the table's.{rest}")


def counts_trajectories(record: Record) -> bool:
    """Whether a record's data is counted in recorded trajectories; else expert trajectories join the offline data."""
    return "offline_trajectories" in record.identity["recipe"]


def _files(records: Sequence[Record]) -> str:
    """What the files are called, where all records were made of the same; the other part is generated."""
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
        f"Offline data: {values('offline_transitions', records)} transitions and, with their actions, {mixed}{none}. "
        f"Expert data: {' or '.join(shown)}, observations only."
    )


def sees_the_mix(record: Record) -> bool:
    """Whether the expert trajectories of its recipe were in the offline data of a record."""
    return bool(record.identity.get("expert_joins", True))


def _there(record: Record, field: str) -> tuple[int, int]:
    """How much there was, and how much the recipe asks for."""
    wanted: int = record.identity["recipe"][field]
    return (wanted if record.counts is None else getattr(record.counts, field)), wanted


def _of_recipe(there: int, wanted: int) -> str:
    return f" of the recipe's {wanted:,}" if there < wanted else ""


def _recorded(records: Sequence[Record]) -> str:
    offline = with_whom(((_offline(record.identity["recipe"]), record.labels.group) for record in records), "; ")
    expert = with_whom(((_expert(record.identity["recipe"]), record.labels.group) for record in records), "; ")
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
    plain = [task for task in dict.fromkeys(record.task for record in records) if task not in tasks]
    rest = f"; not on {', '.join(plain)}" if plain else ""
    return (
        f"{with_whom((_search(tuning), task) for task, tuning in tunings)}; chosen: "
        f"{mostly((', '.join(assignments([tuning.chosen])), task) for task, tuning in tunings)}; "
        f"{runs:,} runs, {steps:,} gradient steps{rest}"
    )


def _search(tuning: Tuning) -> str:
    grid = ", ".join(f"{field} from {', '.join(map(str, values))}" for field, values in tuning.grid.items())
    return f"{grid} by {tuning.criterion}"
