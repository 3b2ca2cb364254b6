from __future__ import annotations

from raw_rows import dilo_triples, exact_triples, make_episodes, q_learning_view, released_mix, walk

from lfobench.contract.suite import Environment, Recipe, Task
from lfobench.data.manifest import manifest
from lfobench.data.source import TaskData


def test_a_manifest_counts_what_the_readers_keep() -> None:
    offline = make_episodes([(6, False), (4, True), (1, True), (6, False), (5, False)])
    expert = make_episodes([(6, False), (3, True), (6, False), (6, False)], start=500)
    recipe = Recipe("medium", 22, "expert", 2, 5)
    environment = Environment("toy", "Toy-v0", 6, 0.0, 10.0)
    task = Task("toy-medium-expert", "medium+expert", environment, recipe, 10)
    counted = manifest(TaskData(task, recipe, offline, expert, {"offline": "a" * 64, "expert": "b" * 64}))

    rows = released_mix(offline, expert, 2, 6)
    triples = dilo_triples(rows)
    starts = {states[0] for states, _, _ in walk(offline) + walk(expert)}
    assert counted.offline_rows == len(rows)
    assert counted.expert_rows_in_mix == len(rows) - len(q_learning_view(offline))
    assert counted.triples == len(triples)
    assert counted.cross_episode == sum(row.second in starts for row in triples)
    assert counted.demonstration_rows == len(dilo_triples(q_learning_view(expert))[:5]) - 1
    exact = exact_triples(offline, "absorbing") + exact_triples(expert.first_episodes(2), "absorbing")
    assert counted.exact_triples == len(exact)
    described = [(part.episodes, part.transitions, part.terminated, part.truncated) for part in counted.parts]
    assert described == [(5, 22, 2, 3), (4, 21, 1, 3)]
    text = "\n".join(counted.sentences())
    assert "a" * 16 in text
    assert "b" * 16 in text
    assert "inside the offline mix" in text
