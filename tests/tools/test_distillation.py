"""Distillation of policies: teachers of any origin, students, cards, and refusals."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from lfobench.errors import UserError
from suites.demonstrators import WEIGHTS, load
from suites.demonstrators.policy import GaussianTanhPolicy
from suites.locomotion import ENVIRONMENTS
from tools.distillation import Settings, distil, make_card, make_student_card, shortfall
from tools.locomotion_distil import main
from tools.locomotion_measure import Difference
from tools.teachers import read_teacher

(HOPPER,) = (environment for environment in ENVIRONMENTS if environment.name == "hopper")
TINY = Settings(rounds=2, transitions=120, round_steps=20, final_steps=40, batch=32, hidden=(8, 8))


def teacher_arrays(inputs: int = 11, actions: int = 3, hidden: int = 16) -> dict[str, Any]:
    generator = np.random.default_rng(3)
    meta = {"source": "made in a test", "path": "nowhere", "licence": "MIT"}
    return {
        "W0": generator.standard_normal((hidden, inputs)) / np.sqrt(inputs),
        "b0": generator.standard_normal(hidden),
        "W1": generator.standard_normal((actions, hidden)) / np.sqrt(hidden),
        "b1": generator.standard_normal(actions),
        "logstd": np.full(actions, -1.0),
        "hidden": np.array("tanh"),
        "squash": np.array(False),
        "meta": np.array(json.dumps(meta)),
    }


def save(path: Path, arrays: dict[str, Any]) -> Path:
    np.savez(path, **arrays)
    return path


def test_shortfall_names_what_is_missing():
    card = {"level": "expert", "environment": {"name": "ant"}}
    card["levels"] = {"sampled": {"score_mean": 109.0}, "deterministic": {"score_mean": 120.0}}
    assert shortfall(card) == "an expert scores at least 110, this one 109.0 sampled"
    card["environment"] = {"name": "hopper"}
    assert shortfall(card) == ""
    card |= {"level": "medium", "teacher": {"levels": {"sampled": {"score_mean": 98.0}}}}
    assert "teacher scores 98.0, this one 109.0" in shortfall(card)


@pytest.mark.parametrize("squash", [False, True])
def test_the_same_seed_gives_the_same_file(tmp_path, squash):
    arrays = teacher_arrays() | {"squash": np.array(squash)}
    teacher = read_teacher(save(tmp_path / "teacher.npz", arrays))
    lines: list[str] = []
    first = distil(HOPPER, teacher, TINY, lines.append)
    assert first == distil(HOPPER, teacher, TINY, lines.append)
    assert first != distil(HOPPER, teacher, dataclasses.replace(TINY, seed=1), lines.append)
    assert lines[:3] == lines[3:6]
    card = make_student_card(HOPPER, "medium", first, teacher, TINY, "a command", episodes=1)
    assert card["teacher"]["sha256"] == hashlib.sha256((tmp_path / "teacher.npz").read_bytes()).hexdigest()
    json.dumps(card)


@pytest.mark.parametrize("squash", [False, True])
def test_a_student_learns_its_teachers_mean_and_noise(tmp_path, squash):
    arrays = teacher_arrays() | {"squash": np.array(squash)}
    teacher = read_teacher(save(tmp_path / "teacher.npz", arrays))
    settings = dataclasses.replace(TINY, transitions=1500, final_steps=1500, batch=256, hidden=(32, 32))
    student = GaussianTanhPolicy(distil(HOPPER, teacher, settings, lambda line: None))
    observation = np.zeros(11, np.float32)
    observation[0] = 1.25
    np.testing.assert_allclose(
        student.mean_action(observation), teacher.mean_action(observation), atol=0.1, err_msg="means"
    )
    generator = np.random.default_rng(0)
    spreads = [
        np.std([policy.act(observation, generator) for _ in range(2000)], axis=0) for policy in (student, teacher)
    ]
    np.testing.assert_allclose(*spreads, atol=0.06)


def test_a_card_names_what_its_maker_gives():
    weights = (WEIGHTS / "hopper-medium.safetensors").read_bytes()
    origin = {"demonstrations": {"episodes": 3}}
    card = make_card(
        HOPPER, "clone", weights, "a command", "cloning", {"steps": 5}, origin, ("numpy", "torch"), episodes=1
    )
    assert set(json.loads((WEIGHTS / "hopper-medium.json").read_text(encoding="utf-8"))) - set(card) == {"teacher"}
    assert (card["level"], card["settings"], card["demonstrations"]) == ("clone", {"steps": 5}, {"episodes": 3})
    assert set(card["versions"]) == {"python", "numpy", "torch"}
    assert card["sha256"] == load("hopper", "medium").fingerprint
    assert card["levels"].keys() == {"sampled", "deterministic"}


def test_episodes_that_begin_alike_are_compared_one_by_one():
    one, other = np.array([1.0, 5.0, 9.0]), np.array([0.0, 5.0, 7.0])
    apart = Difference.between(one, other)
    assert (apart.mean, apart.median_size) == (1.0, 1.0)
    assert apart.error == pytest.approx(1 / np.sqrt(3))
    assert apart.unpaired_error == pytest.approx(np.sqrt((16 + 13) / 3))


def test_exploration_scales_the_noise(tmp_path):
    teacher = read_teacher(save(tmp_path / "teacher.npz", teacher_arrays()))
    rows = np.zeros((1, 11), np.float32)
    np.testing.assert_allclose(np.exp(teacher.calmed(0.5).gaussian(rows)[1]), 0.5 * np.exp(teacher.gaussian(rows)[1]))


def test_the_dapg_layout_is_scaled_on_both_sides(tmp_path):
    arrays = teacher_arrays()
    scaled = arrays | {
        "in_shift": np.full(11, 0.5),
        "in_scale": np.full(11, 2.0),
        "out_shift": np.full(3, 0.1),
        "out_scale": np.full(3, 0.3),
    }
    plain = read_teacher(save(tmp_path / "plain.npz", arrays))
    dapg = read_teacher(save(tmp_path / "dapg.npz", scaled))
    rows = np.random.default_rng(0).standard_normal((5, 11)).astype(np.float32)
    expected = plain.gaussian((rows - np.float32(0.5)) / np.float32(2.0))[0] * 0.3 + 0.1
    np.testing.assert_allclose(dapg.gaussian(rows)[0], expected, atol=1e-6)


def test_the_normalised_layout_is_clipped(tmp_path):
    arrays = teacher_arrays() | {
        "obs_mean": np.zeros(11),
        "obs_var": np.ones(11),
        "obs_eps": np.array(0.0),
        "obs_clip": np.array(2.0),
    }
    teacher = read_teacher(save(tmp_path / "teacher.npz", arrays))
    far, edge = (np.full((1, 11), value, np.float32) for value in (50.0, 2.0))
    np.testing.assert_array_equal(teacher.gaussian(far)[0], teacher.gaussian(edge)[0])


class Hostile:
    """Would write a file when unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (self.path,))


def test_without_a_teacher_one_is_trained():
    pytest.importorskip("sb3_contrib")
    from tools.locomotion_scratch import train_teacher

    teacher = train_teacher(HOPPER, steps=40, seed=0)
    assert "TQC" in teacher.provenance["source"]
    student = distil(HOPPER, teacher, TINY, lambda line: None)
    assert np.isfinite(GaussianTanhPolicy(student).mean_action(np.zeros(11, np.float32))).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "either --teacher FILE or --from-scratch STEPS"),
        ({"teacher": Path("none.npz"), "from_scratch": 5}, "either --teacher FILE or --from-scratch STEPS"),
        ({"teacher": Path("none.npz")}, "Cannot use teacher 'none.npz'"),
    ],
)
def test_the_script_explains_a_mistake(arguments, message, capsys, tmp_path):
    with pytest.raises(typer.Exit) as stop:
        main("hopper", "expert", output=tmp_path, **arguments)
    assert stop.value.exit_code == 2
    assert message in " ".join(capsys.readouterr().out.split())
    assert not list(tmp_path.iterdir())


def test_a_pickled_object_is_refused(tmp_path):
    trap = tmp_path / "executed"
    arrays = teacher_arrays() | {"b1": np.array([Hostile(trap)], dtype=object)}
    with pytest.raises(UserError, match=r"teacher\.npz.*allow_pickle=False.*plain arrays"):
        read_teacher(save(tmp_path / "teacher.npz", arrays))
    bare = tmp_path / "bare.npz"
    bare.write_bytes(pickle.dumps(Hostile(trap)))
    with pytest.raises(UserError, match=r"Cannot use teacher 'bare\.npz'"):
        read_teacher(bare)
    assert not trap.exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"W1": np.zeros((3, 5))}, "'W1' has shape"),
        ({"b0": np.full(16, np.nan)}, "'b0' must be finite"),
        ({"W0": np.array("text")}, "'W0' must be finite numbers"),
        ({"hidden": np.array("swish")}, "'hidden' must be tanh or relu"),
        ({"meta": np.array("[]")}, "meta must be a JSON object"),
        ({"meta": np.array("{")}, "Cannot use teacher"),
        ({"logstd": None}, "lacks 'logstd_W'"),
        ({"W1": None}, "at least two layers"),
        ({"bomb": np.zeros(9 * 2**20)}, "unpacks to more than 64 MiB"),
    ],
)
def test_a_malformed_teacher_is_refused(tmp_path, change, message):
    arrays = {name: value for name, value in (teacher_arrays() | change).items() if value is not None}
    path = tmp_path / "teacher.npz"
    np.savez_compressed(path, **arrays)
    with pytest.raises(UserError, match=message):
        read_teacher(path)


def test_a_missing_or_cut_file_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"Cannot use teacher 'none\.npz'"):
        read_teacher(tmp_path / "none.npz")
    path = save(tmp_path / "teacher.npz", teacher_arrays())
    path.write_bytes(path.read_bytes()[:400])
    with pytest.raises(UserError, match=r"Cannot use teacher 'teacher\.npz'"):
        read_teacher(path)


def test_a_teacher_of_another_body_is_refused(tmp_path):
    teacher = read_teacher(save(tmp_path / "teacher.npz", teacher_arrays(inputs=17, actions=6)))
    with pytest.raises(UserError, match="reads 17 columns and gives 6; Hopper-v5 has 11"):
        distil(HOPPER, teacher, TINY, lambda line: None)
