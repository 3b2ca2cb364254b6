"""``--source``: what a task is read from, in which environment and by which recipe."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lfobench.cells.parts import FilePart, requests
from lfobench.cells.plan import Request, make_plan
from lfobench.cells.sources import absent_files, choose_source, nowhere, read_from, spelled
from lfobench.contract.suite import DataFile, Environment, Files, Suite, Task, own_file
from lfobench.errors import UserError
from lfobench.registry import load_suite

TINY = str(Path(__file__).parents[1] / "tiny_suite.py")
OFFLINE, EXPERT = (
    DataFile("there-random-v2", ("https://example.org/a",)),
    DataFile("there-expert-v2", ("https://e.org/b",)),
)
ELSEWHERE = Environment("pole", "CartPole-v1", 77, 0.0, 1.0)


@pytest.fixture
def suite() -> Suite:
    loaded = load_suite(TINY)
    first, *others = loaded.tasks
    with_files = replace(first, files={"there": Files(OFFLINE, EXPERT, environment=ELSEWHERE)})
    return replace(loaded, tasks=(with_files, *others))


def here(file: DataFile, source: str) -> DataFile:
    return replace(file, path=f"/data/{source}/{file.name}", sha256="5" * 64)


def test_auto_generates_where_the_suite_can(suite: Suite) -> None:
    assert choose_source("auto", suite) == ("generated", None)
    assert choose_source("auto", replace(suite, demonstrator=None)) == ("there", None)
    assert choose_source("generated", suite) == ("generated", None)


def test_own_files_by_part(suite: Suite) -> None:
    name, files = choose_source("expert=~/one.hdf5, offline=two.hdf5", suite)
    assert name == "files"
    assert files == Files(own_file(str(Path("two.hdf5").resolve())), own_file(str(Path("~/one.hdf5").expanduser())))
    assert choose_source("expert=a.hdf5", suite)[1] == Files(expert=own_file(str(Path("a.hdf5").resolve())))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("theer", "Did you mean 'there'"),
        ("some.hdf5", "does not say which part the file is.*--source offline=some.hdf5"),
        ("middle=a.hdf5", "'middle=a.hdf5' is not a part and its path"),
        ("offline=a.hdf5,offline=b.hdf5", "names offline twice"),
        ("offline=", "'offline=' is not a part and its path"),
        ("keys=a+b", "names no file"),
        ("offline=a.hdf5,expert.keys=a", "names keys of the expert part, and no file"),
        ("offline=a.hdf5,keys=a++b", "does not say what an observation is made of"),
        ("offline=a.hdf5,keys=a+a", "does not say what an observation is made of"),
        ("offline=~nobody-of-that-name/a.hdf5", "--source: "),
    ],
)
def test_what_is_no_source_is_refused(suite: Suite, text: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        choose_source(text, suite)


def test_a_source_has_its_own_environment_and_hashes(suite: Suite) -> None:
    task = suite.tasks[0]
    (read,) = read_from([task], "there", None, here)
    assert read.environment == ELSEWHERE and read.recipe == task.recipe
    offline, expert = requests(suite, read, read.recipe)
    assert (offline.path, expert.path) == ("/data/there/there-random-v2", "/data/there/there-expert-v2")
    assert offline.specification == FilePart("there-random-v2", "5" * 64, 77)
    assert absent_files([read]) == []


def test_a_part_that_is_no_file_is_generated(suite: Suite) -> None:
    (read,) = read_from([suite.tasks[0]], "files", Files(expert=own_file("/data/a.hdf5")), here)
    offline, expert = requests(suite, read, read.recipe)
    assert offline == requests(suite, suite.tasks[0], suite.tasks[0].recipe)[0]
    assert isinstance(expert.specification, FilePart)
    assert read.environment == suite.tasks[0].environment


def test_an_own_file_has_one_place() -> None:
    assert own_file("~/a.hdf5").path == str(Path("~/a.hdf5").expanduser())
    with pytest.raises(ValueError, match="is relative"):
        own_file("a.hdf5")


def test_own_files_are_read_as_the_published_ones_are(suite: Suite) -> None:
    published = Files(replace(OFFLINE, columns=3), replace(EXPERT, columns=3), returns=False)
    task = replace(suite.tasks[0], files={"there": published})
    (read,) = read_from([task], "files", Files(offline=own_file("/data/a.hdf5")), here)
    assert read.read_from is not None and read.read_from.offline is not None
    assert (read.read_from.offline.columns, read.read_from.returns) == (3, False)


def test_files_that_are_not_here_can_be_planned_and_are_named_once(suite: Suite) -> None:
    twice = [suite.tasks[0], replace(suite.tasks[0], name="again")]
    read = read_from(twice, "there", None, nowhere)
    assert absent_files(read) == [OFFLINE, EXPERT]
    offline, expert = requests(suite, read[0], read[0].recipe)
    assert offline.path is None
    assert offline.specification.hash != expert.specification.hash


def test_a_task_that_a_source_does_not_have(suite: Suite) -> None:
    first, second = (task.name for task in suite.tasks[:2])
    said = f"Task '{second}' has no source 'there', only generated. Choose those that have it: --tasks {first}"
    with pytest.raises(UserError, match=said):
        read_from(suite.tasks, "there", None, here)


def test_without_named_tasks_those_that_a_source_has_are_planned() -> None:
    plan = make_plan(Request("bc", "locomotion", source="minari", protocol="smoke"), lambda: False)
    named = {task.name for task in plan.tasks}
    assert named and plan.left_out and not named & set(plan.left_out)
    assert named | set(plan.left_out) == {task.name for task in load_suite("locomotion").tasks}
    with pytest.raises(UserError, match=f"Task '{plan.left_out[0]}' has no source 'minari'"):
        make_plan(Request("bc", "locomotion", plan.left_out[0], source="minari", protocol="smoke"), lambda: False)


def test_keys_of_both_parts_or_of_one(suite: Suite) -> None:
    text = "offline=/a.hdf5,expert=/b.hdf5,keys=position+velocity,expert.keys=state"
    _, files = choose_source(text, suite)
    assert files == Files(own_file("/a.hdf5", ("position", "velocity")), own_file("/b.hdf5", ("state",)))
    (read,) = read_from([suite.tasks[0]], "files", files, here)
    again = spelled(read, "files")
    assert again == "offline=/data/files/a,offline.keys=position+velocity,expert=/data/files/b,expert.keys=state"
    assert choose_source(again, suite)[1] == Files(
        own_file("/data/files/a", ("position", "velocity")), own_file("/data/files/b", ("state",))
    )


def test_keys_are_part_of_what_a_part_is(suite: Suite) -> None:
    def identity(text: str) -> dict[str, object]:
        (read,) = read_from([suite.tasks[0]], "files", choose_source(text, suite)[1], here)
        offline, _ = requests(suite, read, read.recipe)
        assert isinstance(offline.specification, FilePart)
        return offline.specification.identity

    bare, keyed = identity("offline=/a.hdf5"), identity("offline=/a.hdf5,keys=a+b")
    assert "keys" not in bare  # so that what was imported before is what it was
    assert keyed == {**bare, "keys": ["a", "b"]}
    assert identity("offline=/a.hdf5,keys=b+a") != keyed


@pytest.mark.parametrize("keys", ["position", (), ("a", "a"), ("",), ("\x1b[2J",), (3,)])
def test_what_are_no_keys(keys: object) -> None:
    with pytest.raises(ValueError, match="keys are "):
        own_file("/a.hdf5", keys)  # type: ignore[arg-type]


def test_a_link_stands_for_a_path_that_cannot_be_written(tmp_path: Path, suite: Suite) -> None:
    (tmp_path / "one,two.hdf5").touch()
    (tmp_path / "link.hdf5").symlink_to(tmp_path / "one,two.hdf5")
    _, files = choose_source(f"offline={tmp_path / 'link.hdf5'}", suite)
    assert files is not None and files.offline is not None
    assert files.offline.path == str(tmp_path / "link.hdf5")


def test_what_cannot_be_generated_says_what_can_be_read(suite: Suite) -> None:
    bare = replace(suite, demonstrator=None)
    task: Task = bare.tasks[0]
    with pytest.raises(UserError, match=r"cannot generate the .* part of .*Choose another --source: there"):
        requests(bare, task, task.recipe)


def test_recordings_may_be_files_of_so_many_trajectories() -> None:
    request = Request("bc", "airhockey", "puck-striking-20-expert", source="offline=/a.hdf5,expert=/b.hdf5")
    (cell,) = make_plan(request, lambda: False, here).cells
    offline, expert = requests(load_suite("airhockey"), cell.task, cell.recipe)
    assert isinstance(offline.specification, FilePart) and isinstance(expert.specification, FilePart)
    assert (offline.transitions, offline.trajectories) == (None, 50)
    assert (expert.transitions, expert.trajectories) == (None, 20)


def test_demonstrations_of_a_user_s_file_are_counted_in_trajectories() -> None:
    """Of a published file in rows, as published; a recipe of trajectories stays what it is."""
    for source, rows in (("expert=/b.hdf5", None), ("offline=/a.hdf5", 60), ("generated", 60)):
        cells = make_plan(Request("bc", TINY, protocol="smoke", source=source), lambda: False, here).cells
        assert {(cell.recipe.demonstration_rows, cell.recipe.observed) for cell in cells} == {(rows, 1)}


def test_the_data_of_a_cell_is_the_content_of_its_files() -> None:
    def plan(digit: str) -> dict[str, str]:
        request = Request("bc", TINY, protocol="smoke", source="expert=/a.hdf5")
        cells = make_plan(request, lambda: False, lambda file, _: replace(file, sha256=digit * 64)).cells
        assert cells[0].identity["source"] == "files"
        return dict(cells[0].data)

    assert plan("5")["expert"] != plan("6")["expert"]
    assert plan("5")["offline"] == plan("6")["offline"]
