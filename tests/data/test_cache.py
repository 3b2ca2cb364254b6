"""Shards on disk: whole or absent, and never believed without a check."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_cli import process
from helpers_engine import HOPPER_TASK, TINY
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from raw_rows import make_episodes, walk
from safetensors.numpy import save_file

import lfobench.data.cache
from lfobench.cells.parts import PartRequest, PartSpecification, specification
from lfobench.contract.episodes import concatenate
from lfobench.contract.suite import Level
from lfobench.data.build import ShardJob, build, missing_shards, roll_out
from lfobench.data.cache import ARRAYS, PartCache, fingerprint, open_shard, read_into, reserve
from lfobench.errors import UserError
from lfobench.files import TEMPORARY_SUFFIX, remove_leftovers
from lfobench.registry import load_suite

SHARD = 120
REBUILD = "lfobench data build tiny --protocol smoke"


def part(level: Level = "random", task: str = "pole-random-expert", suite: str = TINY) -> PartSpecification:
    """A part in shards small enough for a test."""
    loaded = load_suite(suite)
    return replace(
        specification(loaded, next(each for each in loaded.tasks if each.name == task), level), shard_transitions=SHARD
    )


def fill(cache: PartCache, shards: int, suite: str = TINY) -> None:
    demonstrator = load_suite(suite).demonstrator(cache.specification.environment.name, cache.specification.level)
    for shard in range(shards):
        cache.write(shard, roll_out(cache.specification, demonstrator, shard))


@pytest.fixture
def cache(tmp_path: Path) -> PartCache:
    filled = PartCache(tmp_path / "cache", part())
    fill(filled, 2)
    return filled


def test_what_is_written_is_read(tmp_path: Path) -> None:
    store, episodes = PartCache(tmp_path, part()), make_episodes([(3, True), (5, False)])
    store.write(4, episodes)
    read, mark = store.read(4, REBUILD)
    assert walk(read) == walk(episodes)
    assert np.array_equal(read.rewards, episodes.rewards)
    assert mark == fingerprint(episodes)
    assert [path.name for path in store.folder.iterdir()] == [store.path(4).name]


def test_whoever_may_read_other_files_may_read_a_shard(tmp_path: Path) -> None:
    store, other = PartCache(tmp_path, part()), tmp_path / "other"
    store.write(0, make_episodes([(3, True)]))
    other.touch()
    assert store.path(0).stat().st_mode == other.stat().st_mode


def test_the_declared_fingerprint_is_the_one_that_loading_finds(cache: PartCache) -> None:
    _, found = cache.load(SHARD + 1, REBUILD)
    assert cache.declared_fingerprint(SHARD + 1) == found
    assert cache.declared_fingerprint(SHARD) not in (found, None)
    assert cache.declared_fingerprint(3 * SHARD) is None, "the third shard is not there"


def cut(path: Path, cache: PartCache) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def empty(path: Path, cache: PartCache) -> None:
    path.write_bytes(b"")


def missing(path: Path, cache: PartCache) -> None:
    path.unlink()


def neighbour(path: Path, cache: PartCache) -> None:
    shutil.copy(cache.path(1), path)


def other_part(path: Path, cache: PartCache) -> None:
    other = PartCache(cache.root, part("expert"))
    fill(other, 1)
    shutil.copy(other.path(0), path)


def text(path: Path, cache: PartCache) -> None:
    path.write_text("not a shard")


def folder(path: Path, cache: PartCache) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("damage", [cut, empty, missing, neighbour, other_part, text, folder])
def test_damage_is_named_with_the_way_out(cache: PartCache, damage: Callable[[Path, PartCache], None]) -> None:
    path = cache.path(0)
    damage(path, cache)
    with pytest.raises(UserError) as refused:
        cache.load(SHARD + 1, REBUILD)
    assert str(path) in str(refused.value)
    assert REBUILD in str(refused.value)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(where=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_any_flipped_bit_is_found(cache: PartCache, where: float, bit: int) -> None:
    path = cache.path(0)
    whole = path.read_bytes()
    place = int(where * len(whole))
    path.write_bytes(whole[:place] + bytes([whole[place] ^ (1 << bit)]) + whole[place + 1 :])
    try:
        with pytest.raises(UserError, match=re.escape(str(path))):
            cache.read(0, REBUILD)
    finally:
        path.write_bytes(whole)
    cache.read(0, REBUILD)


def test_shards_lie_end_to_end(tmp_path: Path) -> None:
    store = PartCache(tmp_path, part())
    pieces = [make_episodes([(70, True), (60, False)], start=1_000 * shard) for shard in range(7)]
    for shard, piece in enumerate(pieces):
        store.write(shard, piece)
    whole, _ = store.load(7 * SHARD, REBUILD)
    expected = concatenate(pieces).first_transitions(7 * SHARD)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(whole, name), getattr(expected, name))


def signed(store: PartCache, shard: int, arrays: dict[str, Any], mark: str = "") -> None:
    """A file that says of itself what this shard's would."""
    description = json.dumps(store.specification.identity, sort_keys=True)
    metadata = {"fingerprint": mark, "specification": description, "shard": str(shard)}
    store.folder.mkdir(parents=True, exist_ok=True)
    save_file(arrays, store.path(shard), metadata)


@pytest.mark.parametrize(
    "change",
    [
        lambda arrays: arrays | {"observations": arrays["observations"].astype(np.float64)},
        lambda arrays: arrays | {"rewards": arrays["rewards"][:, None]},
        lambda arrays: arrays | {"rewards": arrays["rewards"][0]},
        lambda arrays: arrays | {"actions": arrays["actions"][:-1]},
        lambda arrays: arrays | {"more": arrays["lengths"]},
        lambda arrays: {name: array for name, array in arrays.items() if name != "terminated"},
    ],
    ids=["type", "dimension", "scalar", "rows", "more", "fewer"],
)
def test_arrays_that_no_shard_has_are_damage(
    tmp_path: Path, change: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    store, episodes = PartCache(tmp_path, part()), make_episodes([(3, True), (5, False)])
    arrays = {name: getattr(episodes, name) for name in ARRAYS}
    signed(store, 0, arrays, fingerprint(episodes))
    assert walk(store.read(0, REBUILD)[0]) == walk(episodes)
    signed(store, 0, {name: np.asarray(array) for name, array in change(arrays).items()}, fingerprint(episodes))
    with pytest.raises(UserError, match=rf"{re.escape(str(store.path(0)))} .*damaged.*rm "):
        store.read(0, REBUILD)


def test_a_shard_that_does_not_continue_the_others_is_damage(tmp_path: Path) -> None:
    store = PartCache(tmp_path, part())
    for shard, width in enumerate((2, 2, 3)):
        store.write(shard, make_episodes([(SHARD, False)], width=width))
    with pytest.raises(UserError, match=rf"{re.escape(str(store.path(2)))} .*damaged"):
        store.load(3 * SHARD, REBUILD)


def test_a_file_cut_after_its_header_was_read_is_damage(cache: PartCache) -> None:
    file = open_shard(cache.path(0))
    _, (place,) = reserve([file])
    cache.path(0).write_bytes(b"cut")
    with pytest.raises((OSError, ValueError)):
        read_into(place, file)


def test_checking_reads_what_is_there(cache: PartCache) -> None:
    cache.check(3 * SHARD, REBUILD)
    cut(cache.path(1), cache)
    with pytest.raises(UserError, match=re.escape(str(cache.path(1)))):
        cache.check(3 * SHARD, REBUILD)
    cache.check(SHARD, REBUILD)


def test_same_seed_same_fingerprint(tmp_path: Path, cache: PartCache) -> None:
    again = PartCache(tmp_path / "again", part())
    fill(again, 2)
    for shard in range(2):
        assert again.read(shard, REBUILD)[1] == cache.read(shard, REBUILD)[1]
    assert cache.read(0, REBUILD)[1] != cache.read(1, REBUILD)[1], "shards are drawn independently"


@pytest.mark.slow
def test_hopper_is_reproducible(tmp_path: Path) -> None:
    """Built in this process and in a fresh one."""
    levels: tuple[Level, ...] = ("random", "expert")
    here = [hopper_fingerprint(tmp_path / "here", level) for level in levels]
    script = (
        "import sys; from pathlib import Path; from test_cache import hopper_fingerprint\n"
        "print(*(hopper_fingerprint(Path(sys.argv[1]), level) for level in ('random', 'expert')))"
    )
    paths = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parent.parent)])
    answer = process([sys.executable, "-c", script, str(tmp_path / "there")], env={"PYTHONPATH": paths})
    assert answer.out.split() == here, answer.err


def hopper_fingerprint(root: Path, level: Level) -> str:
    """Of one small shard."""
    hopper = PartCache(root, part(level, HOPPER_TASK, "locomotion"))
    fill(hopper, 1, "locomotion")
    return hopper.read(0, REBUILD)[1]


def test_episodes_of_the_simulator_are_whole(cache: PartCache) -> None:
    episodes, _ = cache.load(SHARD, REBUILD)
    assert episodes.transitions == SHARD
    everything, _ = cache.read(0, REBUILD)
    assert everything.transitions >= SHARD
    assert (everything.lengths <= 60).all()
    assert everything.terminated[everything.lengths < 60].all(), "an episode short of the horizon was ended"
    assert np.abs(everything.actions).max() <= 1.0


def test_a_smaller_request_is_a_prefix_of_a_larger_one(cache: PartCache) -> None:
    large, large_mark = cache.load(2 * SHARD, REBUILD)
    for transitions in (1, 50, SHARD, SHARD + 30):
        small, small_mark = cache.load(transitions, REBUILD)
        assert small.transitions == transitions
        assert np.array_equal(small.actions, large.actions[:transitions])
        assert walk(small)[:-1] == walk(large)[: len(small.lengths) - 1]
        assert small_mark != large_mark


def test_a_part_grows_without_touching_what_is_there(tmp_path: Path) -> None:
    growing = PartCache(tmp_path, part())
    fill(growing, 1)
    stamp = growing.path(0).stat().st_mtime_ns
    assert growing.missing(SHARD) == []
    assert growing.missing(3 * SHARD) == [1, 2]
    assert growing.path(0).stat().st_mtime_ns == stamp


def test_a_build_in_progress_elsewhere_is_left_alone(cache: PartCache, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second command starts while this one is in the middle of writing a shard."""
    genuine = lfobench.data.cache.save_file

    def save_and_be_interrupted(*arguments: Any) -> None:
        genuine(*arguments)
        missing_shards(cache.root, TINY, [("pole-random-expert", PartRequest(cache.specification, SHARD))])
        remove_leftovers(cache.root)

    monkeypatch.setattr(lfobench.data.cache, "save_file", save_and_be_interrupted)
    cache.write(0, make_episodes([(3, False)]))
    assert cache.read(0, REBUILD)[0].transitions == 3


def test_the_disk_refuses(tmp_path: Path) -> None:
    """A path below a regular file cannot be written, not even by root."""
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="Cannot write"):
        PartCache(tmp_path / "file", part()).write(0, make_episodes([(3, False)]))


def test_a_full_disk_is_an_error_with_a_way_out_and_no_file(tmp_path: Path, full_disk: None) -> None:
    with pytest.raises(UserError, match="Cannot write"):
        PartCache(tmp_path, part()).write(0, make_episodes([(100_000, False)]))
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.slow
def test_parallel_and_serial_builds_agree(tmp_path: Path) -> None:
    """Real shards, made by two processes and by one."""
    marks: list[set[tuple[Level, int, str]]] = []
    for workers in (1, 2):
        root = tmp_path / str(workers)
        levels: tuple[Level, ...] = ("random", "expert")
        jobs = [ShardJob(root, TINY, "pole-random-expert", level, 0) for level in levels]
        done = list(build(jobs, workers))
        assert {job.level for job in done} == {"random", "expert"}
        task = load_suite(TINY).tasks[0]
        marks.append(
            {
                (
                    job.level,
                    job.shard,
                    PartCache(root, specification(load_suite(TINY), task, job.level)).read(0, REBUILD)[1],
                )
                for job in done
            }
        )
        assert list(root.rglob(f"*{TEMPORARY_SUFFIX}")) == []
    assert marks[0] == marks[1]


def test_shards_wanted_twice_are_built_once(tmp_path: Path) -> None:
    loaded = load_suite(TINY)
    request = PartRequest(specification(loaded, loaded.tasks[0], "expert"), 25_000)
    jobs = missing_shards(tmp_path, TINY, [(task.name, request) for task in loaded.tasks])
    assert [job.shard for job in jobs] == [0, 1, 2]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda arrays: {name: arrays[name] for name in arrays if name != "actions"}, "actions"),
        (lambda arrays: {**arrays, "foo": arrays["rewards"]}, "foo"),
        (
            lambda arrays: {**arrays, "rewards": arrays["actions"]},
            r"rewards.*F32.* 2 .*F32.* 1",
        ),
    ],
)
def test_a_shard_with_other_arrays_names_them(change: Any, named: str, tmp_path: Path) -> None:
    episodes = make_episodes([(3, False)])
    arrays = {name: getattr(episodes, name) for name in ARRAYS}
    save_file(change(arrays), tmp_path / "shard")
    with pytest.raises(ValueError, match=named):
        open_shard(tmp_path / "shard")
