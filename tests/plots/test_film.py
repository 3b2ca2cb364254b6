"""Films: one picture a step, shown as fast as it happened, in files that players read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from test_scene_plots import PUCKS, SCENE, episode

from lfobench.errors import UserError
from lfobench.plots import film as movie
from lfobench.plots.film import Film, Picture, movie_format, write_movie

HELD = 20
"""Pictures of the second for which an end is shown."""


def film() -> Film:
    return Film(PUCKS, "dilo on hitting, seed 0", [episode("missed", 10, 0, True), episode("success", 6, 1, True)])


def pixel(picture: Picture, x: float, y: float) -> tuple[int, int]:
    """Row and column of a place on the table; the view is its length and 2 cm at both ends."""
    scale = picture.shape[1] / 1.97
    return round(picture.shape[0] - (y + 0.40) * scale), round((x + 0.02) * scale)


def test_every_step_has_a_picture_and_an_end_is_held_for_a_second() -> None:
    shown = film()
    assert len(shown) == (11 + HELD) + (7 + HELD)
    assert shown.pictures_per_second == pytest.approx(20.0)
    width, height = shown.size
    assert width % 16 == height % 16 == 0
    pictures = [shown.picture(index) for index in range(len(shown))]
    assert {picture.shape for picture in pictures} == {(height, width, 3)}
    assert all((pictures[index] == pictures[10]).all() for index in range(10, 11 + HELD))
    assert (pictures[9] != pictures[10]).any()
    np.testing.assert_array_equal(shown.picture(3), pictures[3])


def test_the_puck_is_where_it_was() -> None:
    shown, one = film(), episode("missed", 10, 0, True)
    assert one.puck is not None
    for step in (0, 5, 10):
        picture = shown.picture(step)
        red, green, blue = picture[pixel(picture, *one.puck[step])].astype(int)
        assert red > green + 60 > blue, step


def test_an_outcome_shows_at_the_end_only() -> None:
    shown = Film(SCENE, "", [episode("success", 10)])
    before, after = shown.picture(9), shown.picture(10)
    words = slice(25, 48), slice(200, 500)
    assert (before[words] == before[0, 0]).all()
    assert (after[words] != after[0, 0]).any()


@pytest.mark.parametrize("name", ["a.gif", "a.mp4"])
def test_files_hold_every_picture_at_its_time(tmp_path: Path, name: str) -> None:
    shown, path = film(), tmp_path / name
    write_movie(shown, path, movie_format(path))
    if name.endswith("gif"):
        with Image.open(path) as image:
            assert (image.size, image.info["loop"]) == (shown.size, 0)
            durations = []
            for index in range(image.n_frames):
                image.seek(index)
                durations.append(image.info["duration"])
            last = np.asarray(image.convert("RGB")).astype(int)
        assert sum(durations) == 50 * len(shown)
    else:
        reader = pytest.importorskip("imageio_ffmpeg").read_frames(str(path))
        about = next(reader)
        frames = list(reader)
        assert (about["size"], about["fps"], len(frames)) == (shown.size, 20.0, len(shown))
        last = np.frombuffer(frames[-1], np.uint8).reshape(*shown.size[::-1], 3).astype(int)
    assert np.abs(last - shown.picture(len(shown) - 1)).mean() < 6.0


def test_other_endings_and_a_missing_encoder_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert movie_format(Path("a.b.GIF")) == "gif"
    for name in ("film", "film.avi", "gif"):
        with pytest.raises(UserError, match=r"\.gif or \.mp4"):
            movie_format(Path(name))
    monkeypatch.setattr(movie, "find_spec", lambda name: None)
    with pytest.raises(UserError, match=r"lfobench\[video\].*\.gif"):
        movie_format(Path("film.mp4"))


def test_an_encoder_that_cannot_write_says_so_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    with pytest.raises(OSError) as refused:
        write_movie(film(), tmp_path / "nowhere" / "a.mp4", "mp4")
    assert "\n" not in str(refused.value)
