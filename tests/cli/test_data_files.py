"""Files of a suite from the command line: needed, fetched from a host, adopted, checked, trained on, forgotten."""

from __future__ import annotations

import functools
import json
import os
import shutil
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from helpers_cli import InProcess, assert_refused
from helpers_files import make_episodes, write_d4rl, write_minari

SUITE = '''
"""The pole, from files of a host and from a user's own; nothing is generated."""

from lfobench.contract.suite import DataFile, Environment, Files, Recipe, Suite, Task, own_file

POLE = Environment("pole", "InvertedPendulum-v5", 20, 5.0, 60.0)


def there(level):
    return DataFile(f"pole-{{level}}-v0", (f"{host}/pole_{{level}}-v0.hdf5",))


SUITE = Suite(
    "poles",
    "a pole that is read, never made",
    (
        Task(
            "pole-random-expert",
            "random+expert",
            POLE,
            Recipe("random", 3000, "expert", 3, 20),
            paper_steps=100,
            files={{
                "there": Files(there("random"), there("expert")),
                "mine": Files(own_file("{folder}/mine.hdf5"), there("expert")),
            }},
        ),
    ),
    None,
)
'''


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Silent."""


@pytest.fixture
def published(tmp_path: Path) -> Path:
    """What the host has."""
    folder = tmp_path / "host"
    folder.mkdir()
    write_d4rl(folder / "pole_random-v0.hdf5", make_episodes([20] * 30, [False] * 30, 4, 1))
    write_d4rl(folder / "pole_expert-v0.hdf5", make_episodes([20] * 8, [False] * 8, 4, 1))
    return folder


@pytest.fixture
def suite(tmp_path: Path, published: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "cache"))
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(published)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    path = tmp_path / "poles.py"
    path.write_text(SUITE.format(host=f"http://127.0.0.1:{server.server_port}", folder=tmp_path))
    yield path
    server.shutdown()
    server.server_close()


def training(suite: Path, out: Path) -> tuple[object, ...]:
    """The command line of one small run."""
    return "run", "--suite", suite, "--methods", "bc", "--protocol", "smoke", "--seeds", "0", "--out", out


def listed(command: InProcess, suite: Path) -> dict[str, dict[str, object]]:
    rows = json.loads(command("data", "ls", suite, "--source", "there", "--json").out)
    return {row["file"]: row for row in rows}


@pytest.mark.slow
def test_from_the_host_to_the_table_and_back(tmp_path: Path, suite: Path, lfobench_command: InProcess) -> None:
    run = training(suite, tmp_path / "runs")
    planned = lfobench_command(*run, "--dry-run")
    assert planned.code == 0 and "to do     1 of 1 runs" in planned.out
    assert "2 files to fetch: pole-random-v0, pole-expert-v0" in " ".join(planned.out.split())
    assert "2 files" in next(line for line in planned.out.splitlines() if "pole-random-expert" in line)
    lacking = json.loads(lfobench_command(*run, "--dry-run", "--json").out)["data_lacking"]
    assert lacking == {"pole-random-expert": {"shards": 0, "files": ["pole-random-v0", "pole-expert-v0"]}}
    assert_refused(lfobench_command(*run), "Not here: the data files pole-random-v0, pole-expert-v0. Fetch: lfobench")
    assert [row["path"] for row in listed(lfobench_command, suite).values()] == [None, None]
    absent = lfobench_command("show", "pole-random-expert", "--suite", suite).out
    assert "files not here: pole-random-v0, pole-expert-v0; fetch them: lfobench data download" in " ".join(
        absent.split()
    )

    assert lfobench_command("data", "download", suite).code == 0
    rows = listed(lfobench_command, suite)
    assert all(Path(str(row["path"])).is_file() and row["sha256"] for row in rows.values())
    shown = ("show", "pole-random-expert", "--suite", suite, "--protocol", "smoke")
    assert "data not built yet: lfobench data build" in lfobench_command(*shown).out
    assert lfobench_command("data", "build", suite, "--protocol", "smoke").code == 0
    counted = " ".join(lfobench_command(*shown).out.split())
    assert "offline (random): 30 episodes, 600 transitions" in counted
    # 30 x 19 rows, and 2 counts of 20 rows of an expert whose episodes have 19, the last one excluded.
    assert "offline mix: 609 transitions, 39 of them expert" in counted
    examined = ("data", "doctor", *shown[1:])
    assert "0 of 80 expert rows are, to the last bit, rows of the offline part" in lfobench_command(*examined).out
    found = json.loads(lfobench_command(*examined, "--json").out)
    assert (found["expert_rows_inside_offline"], len(found["offline"]["lengths"])) == (0, 30)
    assert lfobench_command("data", "verify", suite).out.endswith("2 files are what they were.\n")
    assert lfobench_command(*run).code == 0
    footnote = " ".join(lfobench_command("table", "--out", tmp_path / "runs").out.split())
    assert (
        "there (offline pole-random-v0, expert pole-expert-v0). Offline data: 600 of the recipe's 2,000 transitions and"
        in footnote
    )
    assert "nothing: all 1 runs are done" in lfobench_command(*run).out

    made = tmp_path / "cache" / "imported"
    assert len(list(made.iterdir())) == 2
    assert lfobench_command("data", "rm", suite, "--yes").out == "Forgot 2 files, deleted 2.\n"
    assert not list(made.iterdir()), "what was made of the files"
    assert not [path for path in (tmp_path / "cache" / "files").rglob("*") if path.suffix in (".json", ".hdf5")]
    assert [row["path"] for row in listed(lfobench_command, suite).values()] == [None, None]


def test_files_are_adopted_where_they_lie(suite: Path, published: Path, lfobench_command: InProcess) -> None:
    (published / "pole_expert-v0.hdf5").rename(published / "pole-expert-v0.hdf5")
    assert lfobench_command("data", "download", suite, "--from", published).code == 0
    found = listed(lfobench_command, suite)
    assert found["pole-random-v0"]["path"] == str(published / "pole_random-v0.hdf5")
    assert found["pole-expert-v0"]["path"] == str(published / "pole-expert-v0.hdf5")
    said = lfobench_command("data", "rm", suite, "--yes").out
    assert said == "Forgot 2 files, deleted 0; 2 that were not downloaded stay where they lie.\n"
    assert len(list(published.iterdir())) == 2


def test_what_a_folder_lacks_is_named(suite: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    outcome = lfobench_command("data", "download", suite, "--from", tmp_path)
    assert outcome.code == 1
    assert f"Not in {tmp_path}: pole-random-v0, pole-expert-v0." in outcome.err
    assert_refused(lfobench_command("data", "download", suite, "--from", tmp_path / "none"), "No folder", "--from")


def test_what_is_not_of_the_environment_takes_no_name(
    suite: Path, published: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    write_d4rl(published / "pole_random-v0.hdf5", make_episodes([20] * 3, [False] * 3, 5, 1))
    assert_refused(
        lfobench_command("data", "download", suite),
        "pole-random-v0 could not be fetched",
        "its observations have 5 columns, those of InvertedPendulum-v5 4",
        "by hand",
    )
    assert listed(lfobench_command, suite)["pole-random-v0"]["path"] is None
    assert listed(lfobench_command, suite)["pole-expert-v0"]["path"] is not None, "the others are fetched all the same"


def test_what_is_put_in_place_by_hand_is_looked_at(
    suite: Path, published: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    place = tmp_path / "cache" / "files" / "there"
    place.mkdir(parents=True)
    (place / "pole-random-v0.hdf5").write_text("<html>Log in</html>")
    assert "it is a web page" in lfobench_command("data", "download", suite).err
    (place / "pole-random-v0.hdf5").write_bytes((published / "pole_random-v0.hdf5").read_bytes())
    assert lfobench_command("data", "download", suite).code == 0


def test_a_file_that_changed_is_not_trained_on(
    suite: Path, published: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    lfobench_command("data", "download", suite, "--from", published)
    write_d4rl(published / "pole_random-v0.hdf5", make_episodes([20] * 31, [False] * 31, 4, 1))
    run = ("run", "--suite", suite, "--methods", "bc", "--protocol", "smoke", "--out", tmp_path / "runs")
    assert_refused(
        lfobench_command(*run), "is not the pole-random-v0 that was first used here", "Put the old file back"
    )


@pytest.mark.slow
def test_own_files_in_a_suite_file_and_on_the_command_line(
    suite: Path, published: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    mine = write_minari(tmp_path / "mine.hdf5", make_episodes([20] * 30, [False] * 30, 4, 1))
    run = training(suite, tmp_path / "runs")
    lfobench_command("data", "download", suite, "--source", "mine")
    rows = json.loads(lfobench_command("data", "ls", suite, "--source", "mine", "--json").out)
    assert {row["file"]: row["path"] for row in rows}["mine"] == str(mine)
    assert lfobench_command(*run, "--source", "mine").code == 0
    expert = published / "pole_expert-v0.hdf5"
    assert lfobench_command(*run, "--source", f"offline={mine},expert={expert}").code == 0
    other = write_d4rl(tmp_path / "other.hdf5", make_episodes([20] * 3, [False] * 3, 3, 1))
    too_narrow = "its observations have 3 columns, those of InvertedPendulum-v5 4"
    narrow = lfobench_command(*run, "--source", f"offline={other},expert={expert}")
    assert narrow.code == 2 and too_narrow in narrow.err and "seed 0" not in narrow.err, "before anything trains"
    building = ("data", "build", suite, "--protocol", "smoke", "--source", f"offline={other},expert={expert}")
    assert_refused(lfobench_command(*building), too_narrow)
    page = tmp_path / "page.hdf5"
    page.write_text("<html>")
    assert_refused(lfobench_command(*run, "--source", f"offline={page},expert={expert}"), "it is a web page")


def test_the_documented_suite_of_own_data(
    tmp_path: Path, lfobench_command: InProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LFOBENCH_CACHE", str(tmp_path / "cache"))
    suite = shutil.copy(Path(__file__).parents[2] / "docs" / "own_data.py", tmp_path)
    write_d4rl(tmp_path / "mine.hdf5", make_episodes([50] * 20, [True] * 20, 11, 3))
    write_d4rl(tmp_path / "theirs.hdf5", make_episodes([60] * 31, [True] * 31, 11, 3))
    assert lfobench_command("data", "build", suite).code == 0
    shown = " ".join(lfobench_command("show", "hopper-mine-expert", "--suite", suite).out.split())
    assert "recipe (quick): 200,000 mine transitions + 30 expert trajectories" in shown
    assert "offline mix: 2,798 transitions, 1,799 of them expert, with actions" in shown


def test_what_files_lack_is_said_before_anything_trains(
    suite: Path, published: Path, tmp_path: Path, lfobench_command: InProcess
) -> None:
    write_d4rl(tmp_path / "one.hdf5", make_episodes([20], [False], 4, 1))
    write_d4rl(tmp_path / "row.hdf5", make_episodes([1], [False], 4, 1))
    offline, run = f"offline={published / 'pole_random-v0.hdf5'}", training(suite, tmp_path / "runs")
    lonely = lfobench_command(*run, "--source", f"{offline},expert={tmp_path / 'one.hdf5'}")
    assert lonely.code == 0
    said = lonely.err.index(
        "has 1 trajectory of the 2 that the recipe mixes into the offline data; all of them are in it"
    )
    assert said < lonely.err.index("seed 0: score") and lonely.err.count("that the recipe mixes into") == 1
    quiet = lfobench_command(*run, "--steps", "20", "--json", "--source", f"{offline},expert={tmp_path / 'one.hdf5'}")
    assert quiet.code == 0 and "the recipe mixes" not in quiet.err
    empty = lfobench_command(*run, "--source", f"{offline},expert={tmp_path / 'row.hdf5'}")
    assert empty.code == 2 and "of its 1 row, 0 have two successors in their episode" in empty.err


def test_a_suite_without_files(lfobench_command: InProcess) -> None:
    assert lfobench_command("data", "ls", "airhockey").out == "No data files: everything here is generated.\n"
    assert_refused(lfobench_command("data", "download", "airhockey"), "has no data files", "data build")
    assert_refused(
        lfobench_command("data", "download", "locomotion", "--source", "d4lr"), "d4lr", "Did you mean 'd4rl'"
    )


def test_a_task_says_which_suite_it_is_of(lfobench_command: InProcess) -> None:
    rows = json.loads(lfobench_command("data", "ls", "pen-human-expert", "--source", "d4rl", "--json").out)
    found = [(row["suites"], row["file"]) for row in rows]
    assert found == [(["adroit"], "pen-human-v0"), (["adroit"], "pen-expert-v0")]
    assert "kitchen-mixed-v0" in lfobench_command("show", "kitchen-mixed-expert", "--source", "d4rl").out
    assert_refused(
        lfobench_command("data", "download", "pen-human-expert", "--tasks", "pen-*"), "is one task", "Leave out"
    )
    for command in ("verify", "doctor", "status"):
        assert_refused(lfobench_command("data", command, "pen-humn-expert"), "Did you mean 'pen-human-expert'?")
    own = ("--suite", Path(__file__).parents[2] / "docs" / "own_data.py")
    for name in ("hopper-mine-exprt", "hopper-random-expert"):
        refused = lfobench_command("data", "doctor", name, *own)
        assert_refused(refused, f"Unknown file or task '{name}'. Did you mean 'hopper-mine-expert'?")
    assert "scripted" in lfobench_command("data", "status", "pen-human-expert").out


def test_a_glob_over_all_suites_names_those_that_have_such_tasks(lfobench_command: InProcess) -> None:
    rows = json.loads(lfobench_command("data", "ls", "--tasks", "pen-*", "--source", "d4rl", "--json").out)
    assert {suite for row in rows for suite in row["suites"]} == {"adroit", "adroit-paper", "table1", "table1-paper"}
    assert [row["file"] for row in rows] == ["pen-cloned-v0", "pen-expert-v0", "pen-human-v0"], "each once"
    assert_refused(lfobench_command("data", "ls", "--tasks", "pan-*"), "Unknown task 'pan-*'")
    every = json.loads(lfobench_command("data", "ls", "--source", "d4rl", "--json").out)
    assert len({row["file"] for row in every}) == len(every) == 24
    assert_refused(lfobench_command("data", "ls", "--source", "d4lr"), "Unknown source 'd4lr'. Did you mean 'd4rl'?")


def test_a_damaged_note_is_shown_and_can_be_forgotten(suite: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    lfobench_command("data", "download", suite)
    note = tmp_path / "cache" / "files" / "there" / "pole-random-v0.json"
    note.write_text("{")
    rows = listed(lfobench_command, suite)
    assert "is damaged" in str(rows["pole-random-v0"]["problem"]) and rows["pole-expert-v0"]["problem"] is None
    assert lfobench_command("data", "rm", suite, "--yes").out == "Forgot 2 files, deleted 2.\n"
    assert not note.exists()


def test_two_own_files_of_one_name_are_two_rows(suite: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    own = f'Files(own_file("{tmp_path}/a/x.hdf5"), own_file("{tmp_path}/b/x.hdf5"))'
    suite.write_text(suite.read_text().replace('Files(there("random"), there("expert"))', own))
    assert len(json.loads(lfobench_command("data", "ls", suite, "--source", "there", "--json").out)) == 2


def test_one_file_for_both_parts_is_one_file(suite: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    suite.write_text(suite.read_text().replace('there("expert")', 'there("random")'))
    planned = lfobench_command(*training(suite, tmp_path), "--source", "there", "--dry-run", "--json")
    assert json.loads(planned.out)["data_lacking"]["pole-random-expert"]["files"] == ["pole-random-v0"]


def test_what_cannot_be_deleted_is_named(suite: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    (tmp_path / "cache" / "files" / "there" / "pole-random-v0.json").mkdir(parents=True)
    assert_refused(lfobench_command("data", "rm", suite, "--source", "there", "--yes"), "Cannot delete", "by hand")


def test_own_files_are_not_held_to_a_hash(suite: Path, tmp_path: Path, lfobench_command: InProcess) -> None:
    own = suite.read_text().replace(
        'Files(there("random"), there("expert"))', f'Files(own_file("{tmp_path}/mine.hdf5"))'
    )
    suite.write_text(own.replace(', there("expert")', ""))
    assert lfobench_command("data", "verify", suite).out.startswith("Nothing to verify: these files are your own")


def test_a_name_that_cannot_be_written_down_is_refused(tmp_path: Path, lfobench_command: InProcess) -> None:
    for name in ("l\udce9.hdf5", "\x1b[31m.hdf5"):
        refused = lfobench_command("data", "build", "locomotion", "--source", f"offline={tmp_path / name}")
        assert_refused(refused, "cannot be written down")
        assert "\x1b" not in refused.err


@pytest.mark.skipif(os.geteuid() == 0, reason="root may look anywhere")
def test_a_folder_that_may_not_be_entered(tmp_path: Path, lfobench_command: InProcess) -> None:
    (tmp_path / "closed").mkdir(mode=0)
    path = tmp_path / "closed" / "file.hdf5"
    assert_refused(lfobench_command("data", "doctor", path), f"Cannot look at {path}: Permission denied")
