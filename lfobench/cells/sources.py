"""Sources of a task's data: ``--source`` turned into tasks with the files that they are read from."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lfobench.cells.names import chosen_tasks, split_names
from lfobench.contract.suite import GENERATED, DataFile, Files, Recipe, Suite, Task, check_keys, own_file
from lfobench.errors import UserError, unknown_name

OWN = "files"
"""Files that the user names. Any other source but the generated one is one that a suite declares."""

PARTS, KEYS = ("offline", "expert"), "keys"

Find = Callable[[DataFile, str], DataFile]
"""A file and its source to the same file with its path and hash, where it is here."""


def nowhere(file: DataFile, source: str) -> DataFile:
    """Finds no file."""
    return file


def choose_source(text: str, suite: Suite) -> tuple[str, Files | None]:
    """The source's name, and the files that the user names.

    Args:
        text: ``auto``, ``generated``, a source that the suite declares, or ``offline=PATH,expert=PATH``, of which one
            may be left out; ``keys=A+B`` says what an observation of both is made of, ``offline.keys=A+B`` of one.
        suite: whose source it is; for ``auto``, what can be generated is, and else its first source is taken.

    Raises:
        UserError: an unknown source, or a path that does not say which part it is.
    """
    declared = list(dict.fromkeys(name for task in suite.tasks for name in task.files))
    if text == "auto":
        return (GENERATED if suite.demonstrator is not None or not declared else declared[0]), None
    if "=" in text:
        return OWN, _own(text)
    if text == GENERATED or text in declared:
        return text, None
    if "/" in text or text.endswith((".hdf5", ".h5")):
        raise UserError(
            f"--source {text} does not say which part the file is.",
            f"Write --source offline={text}, --source expert={text}, or both parts, separated by a comma.",
        )
    raise unknown_name("source", text, ["auto", GENERATED, *declared, "offline=PATH,expert=PATH"])


def split_keys(text: str) -> tuple[str, ...]:
    """``A+B`` to the keys that an observation is made of.

    Raises:
        UserError: one is empty or named twice.
    """
    keys = tuple(text.split("+"))
    try:
        check_keys(keys)
    except ValueError as error:
        raise UserError(f"{text!a} does not say what an observation is made of: {error}.", "Write keys=A+B.") from error
    return keys


def _own(text: str) -> Files:
    values: dict[str, str] = {}
    for pair in split_names(text):
        name, _, value = pair.partition("=")
        if name not in (*PARTS, KEYS, *(f"{part}.{KEYS}" for part in PARTS)) or not value:
            raise UserError(
                f"--source {text}: '{pair}' is not a part and its path.",
                "Write offline=PATH,expert=PATH, and keys=A+B for what an observation is made of. To a path with a "
                "comma in it, make a link.",
            )
        if name in values:
            raise UserError(f"--source names {name} twice.", "Name each part once.")
        values[name] = value
    parts: dict[str, DataFile] = {}
    for part in PARTS:
        keys = values.get(f"{part}.{KEYS}", values.get(KEYS))
        if part in values:
            try:
                # Links stay links: one may stand for a path that cannot be written here.
                place = Path(values[part]).expanduser().absolute()
                parts[part] = own_file(str(place), None if keys is None else split_keys(keys))
            except (ValueError, RuntimeError) as error:  # no home folder of that name
                raise UserError(f"--source: {error}.") from error
        elif f"{part}.{KEYS}" in values:
            raise UserError(f"--source names keys of the {part} part, and no file.", f"Add {part}=PATH.")
    if not parts:
        raise UserError(f"--source {text} names no file.", "Write offline=PATH,expert=PATH.")
    return Files(offline=parts.get("offline"), expert=parts.get("expert"))


def read_from(tasks: Sequence[Task], source: str, own: Files | None, find: Find) -> list[Task]:
    """The tasks as a source has them: read from its files, in its environments, mixed by its recipes.

    Raises:
        UserError: a task that the source does not have.
    """
    if source == GENERATED:
        return list(tasks)
    found = []
    for task in tasks:
        files = task.files.get(source) if own is None else _of_task(own, task)
        if files is None:
            have = [other.name for other in tasks if source in other.files]
            raise UserError(
                f"Task '{task.name}' has no source '{source}', only {', '.join([GENERATED, *task.files])}.",
                f"Choose those that have it: --tasks {','.join(have)}" if have else "Choose another source.",
            )
        offline, expert = (None if file is None else find(file, source) for file in (files.offline, files.expert))
        here = replace(files, offline=offline, expert=expert)
        found.append(
            replace(
                task,
                environment=files.environment or task.environment,
                recipe=_counted(files.recipe or task.recipe, own),
                group=files.group or task.group,
                read_from=here,
            )
        )
    return found


@dataclass(frozen=True)
class ReadTasks:
    """Tasks of a suite as a source has them.

    Attributes:
        source: its name.
        tasks: in the source's form.
        left_out: names of the suite's tasks that the source lacks, where no task was named.
    """

    source: str
    tasks: tuple[Task, ...]
    left_out: tuple[str, ...] = ()


def read_tasks(suite: Suite, globs: str | None, text: str, find: Find) -> ReadTasks:
    """Tasks that ``--tasks`` names, or else all that the source of ``--source`` has.

    Raises:
        UserError: an unknown name, a named task that the source lacks, or own files for tasks that nobody named, of
            several environments.
    """
    source, own = choose_source(text, suite)
    chosen, left_out = chosen_tasks(suite, globs), []
    if globs is None and own is not None:
        _check_one_environment(suite)
    elif globs is None and source != GENERATED:
        left_out = [task.name for task in chosen if source not in task.files]
        chosen = [task for task in chosen if source in task.files]
    return ReadTasks(source, tuple(read_from(chosen, source, own, find)), tuple(left_out))


def _check_one_environment(suite: Suite) -> None:
    names = list(dict.fromkeys(task.environment.name for task in suite.tasks))
    if len(names) > 1:
        raise UserError(
            f"--source names the files of one environment, and the tasks of suite '{suite.name}' have {len(names)} "
            f"({', '.join(names)}).",
            f"Say which tasks the files are for, e.g. --tasks {suite.tasks[0].name}.",
        )


def _counted(recipe: Recipe, own: Files | None) -> Recipe:
    """The recipe as it is for a user's expert file, whose trajectories may have any length: rows are not counted."""
    own_expert = own is not None and own.expert is not None
    return replace(recipe, demonstration_rows=None) if own_expert else recipe


def _of_task(own: Files, task: Task) -> Files:
    """A user's files, read as the task's published ones: so many columns, and rewards that say the return or not."""
    declared = [file for files in task.files.values() for file in (files.offline, files.expert) if file is not None]
    columns = next((file.columns for file in declared if file.columns is not None), None)
    offline, expert = (None if file is None else replace(file, columns=columns) for file in (own.offline, own.expert))
    return replace(own, offline=offline, expert=expert, returns=all(files.returns for files in task.files.values()))


def spelled(task: Task, source: str) -> str:
    """Value of ``--source`` for the data of a task that was read from a source."""
    if source != OWN or task.read_from is None:
        return source
    files = {"offline": task.read_from.offline, "expert": task.read_from.expert}
    return ",".join(
        f"{part}={file.path}" + (f",{part}.{KEYS}={'+'.join(file.keys)}" if file.keys else "")
        for part, file in files.items()
        if file is not None
    )


def absent_files(tasks: Sequence[Task]) -> list[DataFile]:
    """Files that the tasks read and that are not here, each once."""
    found: dict[str, DataFile] = {}
    for task in tasks:
        files = () if task.read_from is None else (task.read_from.offline, task.read_from.expert)
        found |= {file.name: file for file in files if file is not None and file.sha256 is None}
    return list(found.values())


def download_command(suite: str, source: str, task: str | None = None) -> str:
    """Command that fetches the files of a suite's tasks, or of one."""
    words = ["lfobench", "data", "download", suite, "--source", source]
    return shlex.join(words if task is None else [*words, "--tasks", task])


def check_here(tasks: Sequence[Task], suite: str, source: str) -> None:
    """Refuse tasks whose files are not here.

    Raises:
        UserError: naming them and the command that brings them.
    """
    if absent := absent_files(tasks):
        fetch = download_command(suite, source, tasks[0].name if len(tasks) == 1 else None)
        raise UserError(
            f"Not here: the data {'file' if len(absent) == 1 else 'files'} {', '.join(file.name for file in absent)}.",
            f"Fetch: {fetch}; with --from DIR, those you have are used where they lie.",
        )
