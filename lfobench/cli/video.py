"""``lfobench video``: a film of a trained policy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lfobench.cli import options, selection
from lfobench.cli.console import output
from lfobench.cli.inputs import warn

MOST_EPISODES = 12
"""Of one film, whose pictures are held in memory until a GIF is whole."""


def video(
    method: Annotated[str, typer.Argument(help="A method with records, e.g. dilo; one from a file by its path.")],
    task: Annotated[str, typer.Argument(help="A task of a suite that is seen from above.")],
    to: Annotated[Path, typer.Option(help="The file to write: .gif, or .mp4 with the extra 'video'.")],
    out: options.Out = options.DEFAULT_OUT,
    seed: Annotated[int, typer.Option(min=0, help="Whose policy.")] = 0,
    episodes: Annotated[
        str, typer.Option("--episodes", "--episode", help="Fixed starts, one after the other, e.g. 0-3.")
    ] = "0",
    tuned: Annotated[
        bool | None,
        typer.Option("--tuned/--untuned", help="A run whose hyperparameters were chosen, or not."),
    ] = None,
    suite: selection.SuiteFilter = None,
    protocol: selection.ProtocolFilter = None,
    steps: selection.StepsFilter = None,
    source: selection.SourceFilter = None,
    preset: selection.PresetFilter = None,
) -> None:
    """Film a trained policy from above, as fast as it moves; no display and no GPU are needed.

    Example: lfobench video dilo dynamic-hitting-400-expert-hit --out runs --episode 0 --to hit.gif
    """
    from lfobench.cells.names import select_tasks
    from lfobench.engine.trained import of_seed, outcomes_of, scene_of, starts_of, suite_of, traces_of
    from lfobench.errors import UserError, unknown_name
    from lfobench.files import replacing, writable_folder
    from lfobench.plots.film import Film, movie_format, write_movie
    from lfobench.registry import is_place, load_method

    format_name = movie_format(to)
    method = load_method(method).name if is_place(method) else method
    selected = selection.select_records(out, suite, protocol, steps, source, preset, method)
    present = {record.task for record in selected.records}
    if present and task not in present:
        raise unknown_name(f"task among the records of {method}", task, present)
    meant = [
        record
        for record in selected.records
        if record.task == task and (tuned is None or (record.tuning is not None) == tuned)
    ]
    record, *others = of_seed(meant, seed)
    if others:
        raise UserError(
            f"{1 + len(others)} runs of {method} on {task} have seed {seed}.",
            "Choose one with --tuned or --untuned, --preset, --protocol, --steps, --source or --suite; runs that "
            "differ by --set alone need folders of their own.",
        )
    found = suite_of(record, suite)
    scene = scene_of(found)
    of_suite = select_tasks(found.tasks, [task])[0]
    writable_folder(to.parent, "--to")
    traces, warnings = traces_of(out, record, of_suite, starts_of(episodes, record, MOST_EPISODES))
    warn(warnings)
    title = f"{method} on {task}, seed {seed}"
    film = Film(scene(of_suite.environment.name), title, traces, outcomes_of(selected.records))
    with replacing(to) as temporary:
        write_movie(film, temporary, format_name)
    ended = ", ".join(f"start {each.start} {each.outcome}" for each in traces)
    output.out(f"{to}: {len(film) / film.pictures_per_second:.1f} s; {ended}", highlight=False)
