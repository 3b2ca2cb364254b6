"""Your own data as a suite: ``lfobench run --suite docs/own_data.py --methods dilo,smodice,bc``.

It reads two files from its own folder, in any layout that `lfobench data doctor` reads; `keys=("position",
"velocity")` of `own_file` chooses parts of an observation that is a dictionary. The recipe takes at most a million rows
of `mine.hdf5` (200,000 under protocol ``quick``) and at most 30 first trajectories of `theirs.hdf5`, with their
actions; the first one is the demonstration of every method (``demonstrations=3`` takes three). `Recipe.recorded` counts
both files in trajectories, and no expert trajectory joins the offline data. The environment's module may be in the same
folder: ``import my_worlds``, or ``"my_worlds:Reach-v0"`` as the environment's id.
"""

from __future__ import annotations

from pathlib import Path

from lfobench.contract.suite import Environment, Files, Recipe, Suite, Task, own_file

HERE = Path(__file__).resolve().parent

SUITE = Suite(
    name="own-data",
    summary="hopper from my own files",
    tasks=(
        Task(
            name="hopper-mine-expert",
            group="mine+expert",
            # Name, id, steps per episode, and the returns that score 0 and 100.
            environment=Environment("hopper", "Hopper-v5", 1000, -20.272305, 3234.3),
            recipe=Recipe("mine", 1_000_000, "expert", expert_trajectories=30),
            paper_steps=300_000,
            files={"mine": Files(own_file(HERE / "mine.hdf5"), own_file(HERE / "theirs.hdf5"))},
        ),
    ),
    demonstrator=None,
)
