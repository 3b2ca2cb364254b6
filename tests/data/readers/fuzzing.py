"""Mutated data files, by the thousand: ``python tests/data/readers/fuzzing.py COUNT [FIRST]``.

Every mutation of a small file in each layout is either refused for a reason or gives episodes of the right shape.
Anything else, a crash of the process included, ends the script with another code than 0; standard error says which
hundred it was in.
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
from helpers_files import make_episodes, write_d4rl, write_lerobot, write_minari, write_npz, write_robomimic

from lfobench.data.readers.formats import read
from lfobench.data.readers.hdf5 import FileProblem
from lfobench.data.readers.reading import check
from lfobench.data.readers.robomimic import LOW_DIMENSIONAL

NUMBERS = (b"\xff" * 8, b"\0" * 8, b"\x7f" + b"\xff" * 7, (1 << 40).to_bytes(8, "little"), (1).to_bytes(8, "little"))
HORIZON, COLUMNS = 100, (4, 2)
TABLES, TABLE = "dataset", Path("data") / "chunk-000" / "file-000.parquet"
KEYS = ("observation.state", "observation.environment_state")


def originals(folder: Path) -> list[bytes]:
    """One small file in each layout, D4RL's and NPZ with compression too; of LeRobot's, a table."""
    episodes = make_episodes()
    path = folder / "original.hdf5"
    archive = folder / "original.npz"
    write: tuple[Callable[[], Path], ...] = (
        lambda: write_d4rl(path, episodes),
        lambda: write_d4rl(path, episodes, chunks=True, compression="gzip", shuffle=True),
        lambda: write_d4rl(path, episodes, ["timeouts"], chunks=True, fletcher32=True),
        lambda: write_minari(path, episodes),
        lambda: write_robomimic(path, episodes, LOW_DIMENSIONAL),
        lambda: write_npz(archive, episodes),
        lambda: write_npz(archive, episodes, compressed=True),
        lambda: write_lerobot(folder / TABLES, [episodes]) / TABLE,
    )
    return [each().read_bytes() for each in write]


def mutated(original: bytes, chance: random.Random) -> bytes:
    """Cut short, bytes or bits changed, a number overwritten, or a stretch copied to another place."""
    content = bytearray(original)
    how = chance.randrange(5)
    if how == 0:
        return bytes(content[: chance.randrange(len(content))])
    if how == 1:
        for _ in range(chance.choice((1, 2, 8, 64))):
            content[chance.randrange(len(content))] = chance.randrange(256)
    elif how == 2:
        for _ in range(chance.choice((1, 2, 4))):
            content[chance.randrange(min(len(content), 4096))] ^= 1 << chance.randrange(8)
    elif how == 3:
        place = chance.randrange(len(content) - 8)
        content[place : place + 8] = chance.choice(NUMBERS)
    else:
        to, start, length = chance.randrange(len(content)), chance.randrange(len(content)), chance.randrange(1, 512)
        content[to : to + length] = content[start : start + length]
    return bytes(content)


def main(count: int, first: int) -> None:
    """Try `count` mutations and print what became of them."""
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files, path = originals(folder), folder / "mutated.hdf5"
        for number in range(first, first + count):
            chance = random.Random(number)
            content = mutated(files[number % len(files)], chance)
            in_dataset = number % len(files) == len(files) - 1
            (folder / TABLES / TABLE if in_dataset else path).write_bytes(content)
            if number % 100 == 0:
                sys.stderr.write(f"{number}\n")
            try:
                reading = read(folder / TABLES, keys=KEYS) if in_dataset else read(path, HORIZON)
                check(reading)
            except FileProblem:
                outcomes["refused"] += 1
                continue
            found = reading.episodes
            columns = (found.observations.shape[1], found.actions.shape[1])
            if columns != COLUMNS or not found.transitions:
                raise AssertionError(f"mutation {number} was read with {columns} columns, {found.transitions} steps")
            outcomes["read"] += 1
    sys.stdout.write(f"{dict(outcomes)}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
