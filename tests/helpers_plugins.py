"""Packages of somebody else's, as pip leaves them, and small methods as their authors write them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from lfobench import python_files, registry
from lfobench.record import Record
from lfobench.records.folder import RecordFolder

METHOD = '''
import torch
from pydantic import Field

from lfobench.contract.method import DataNeeds, Method, MethodConfig, Stage


class Config(MethodConfig):
    """Of a mean action."""

    beta: float = Field(1.0, description="Step towards the batch's mean action.")


class {class_name}(Method):
    """The mean action of the offline data, whatever is observed."""

    name = "{name}"
    Config = Config
    presets = {{"released": {{}}}}

    @classmethod
    def needs(cls, config):
        return DataNeeds(offline=("observation", "action"))

    def __init__(self, config, shapes, seeds, device):
        self.config = config
        self.mean = torch.zeros(len(seeds), shapes.action, device=device)

    def stages(self, sizes):
        return (Stage("policy", None, 16, 0),)

    def update(self, stage, offline, expert, randomness):
        difference = offline["action"].mean(1) - self.mean
        self.mean += 0.1 * self.config.beta * difference
        return {{"distance": difference.square().mean(1)}}

    def act(self, observation):
        return self.mean[:, None].expand(-1, observation.shape[1], -1).clamp(-1.0, 1.0)

    def state(self):
        return {{"policy.mean": self.mean}}
'''


def method_source(name: str = "mine", class_name: str = "Mine") -> str:
    """A file with a whole method."""
    return METHOD.format(name=name, class_name=class_name)


def install(site: Path, package: str, files: Mapping[str, str], **groups: Mapping[str, str]) -> Path:
    """What pip leaves of a package of version 1.0 in `site`, which it returns.

    Args:
        site: the folder of packages.
        package: its name, on disk and as a distribution.
        files: name of a module to its source.
        groups: `methods` and `suites`, name to what is registered.
    """
    metadata = site / f"{package}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "top_level.txt").write_text(f"{package}\n", encoding="utf-8")
    lines = [
        line
        for group, points in groups.items()
        for line in (f"[lfobench.{group}]", *(f"{name} = {value}" for name, value in points.items()), "")
    ]
    (metadata / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    (site / package).mkdir()
    (site / package / "__init__.py").touch()
    for module, source in files.items():
        (site / package / f"{module}.py").write_text(source, encoding="utf-8")
    return site


def use(site: Path, patch: pytest.MonkeyPatch) -> None:
    """Have this process see the packages of `site`, until the patch is undone."""
    patch.syspath_prepend(str(site))
    forget_registrations()


def forget_registrations() -> None:
    """Have the registry look again at what is installed."""
    registry._points.cache_clear()
    registry._registered_method.cache_clear()
    registry.load_suite.cache_clear()
    registry._given.clear()
    python_files._others.cache_clear()


def records_in(out: Path) -> list[Record]:
    """What a folder holds, by method and seed; there is nothing to warn of."""
    read = RecordFolder(out).read_all()
    assert read.warnings == []
    return sorted(read.records, key=lambda record: (record.method, record.seed))
