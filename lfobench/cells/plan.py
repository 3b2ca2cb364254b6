"""The plan: what a command line asks for, as cells and runs, before anything is computed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from lfobench.cells.cell import (
    NOTHING_ASSIGNED,
    Assigned,
    Cell,
    Protocol,
    Run,
    check_precision,
    configure,
    load_protocol,
)
from lfobench.cells.names import chosen_methods, parse_assignments, parse_seeds
from lfobench.cells.parts import requests, simulator_versions
from lfobench.cells.sources import Find, nowhere, read_tasks
from lfobench.contract.suite import Suite, Task
from lfobench.errors import UserError, unknown_name
from lfobench.registry import load_suite
from lfobench.source_code import code_of

DEVICES = ("cpu", "cuda")


@dataclass(frozen=True)
class Request:
    """Request of a user, as typed."""

    methods: str
    suite: str
    tasks: str | None = None
    seeds: str | None = None
    protocol: str = "auto"
    preset: str = "released"
    assignments: Sequence[str] = field(default_factory=tuple)
    source: str = "auto"
    device: str = "auto"
    assigned: Assigned = NOTHING_ASSIGNED
    precision: str = "auto"
    grids: Sequence[str] = ()


@dataclass(frozen=True)
class Plan:
    """Cells in table order (tasks, then methods) and the seeds of each.

    Attributes:
        suite: the suite.
        cells: one per task and method.
        seeds: the same for every cell.
        protocol: the one that runs.
        protocol_reason: why, when the user left it to us; else empty.
        device: ``cpu`` or ``cuda``.
        left_out: names of the suite's tasks that the source lacks.
    """

    suite: Suite
    cells: tuple[Cell, ...]
    seeds: tuple[int, ...]
    protocol: Protocol
    protocol_reason: str
    device: str
    left_out: tuple[str, ...] = ()

    @property
    def runs(self) -> list[Run]:
        """Every run, cell by cell."""
        return [Run(cell, seed) for cell in self.cells for seed in self.seeds]

    @property
    def tasks(self) -> list[Task]:
        """The tasks, each once."""
        return list({cell.task.name: cell.task for cell in self.cells}.values())


def make_plan(request: Request, cuda_available: Callable[[], bool], find: Find = nowhere) -> Plan:
    """Resolve names to cells.

    Args:
        request: what was typed.
        cuda_available: asked only when the device is left to us or is CUDA.
        find: looks for data files; asked only where the source has any.

    Raises:
        UserError: for anything that does not exist or does not parse; nothing has been written by then.
    """
    device = choose_device(request.device, cuda_available)
    precision = check_precision(request.precision, device)
    protocol, reason = choose_protocol(request.protocol, device)
    protocol = replace(protocol, assigned=request.assigned)
    suite = load_suite(request.suite)
    read = read_tasks(suite, request.tasks, request.source, find)
    methods = {method.name: method for method in chosen_methods(request.methods).values()}
    seeds = tuple(parse_seeds(protocol.seeds if request.seeds is None else request.seeds))
    assigned = parse_assignments(request.assignments, list(methods))
    for task in read.tasks:
        check_environment(task)
    cells = [
        Cell(
            method=method,
            preset=request.preset,
            config=configured.config,
            budget=configured.budget,
            assigned=configured.assigned,
            suite=request.suite,
            suite_name=suite.name,
            task=task,
            protocol=here,
            source=read.source,
            data=data,
            simulator=simulator_versions(task),
            precision=precision,
            code=code_of(method),
        )
        for task in read.tasks
        for data, here in [(_data(suite, task, protocol), protocol.for_task(task))]
        for name, method in methods.items()
        for configured in [configure(method, request.preset, here, assigned.get(name, {}), task.settings.get(name, {}))]
    ]
    for cell in cells:
        _check_actions(cell)
    return Plan(suite, tuple(cells), seeds, protocol, reason, device, read.left_out)


def check_environment(task: Task) -> None:
    """Refuse a task whose environment does not exist, or is not one of flat vectors.

    Raises:
        UserError: naming the environment and the task, or a package that it needs.
    """
    simulator_versions(task)
    try:
        _ = task.environment.spaces
    except UserError as error:
        raise UserError(f"Task '{task.name}': {error.problem}", error.remedy) from error


def _check_actions(cell: Cell) -> None:
    if not cell.task.recipe.expert_actions and "action" in cell.needs.expert:
        raise UserError(
            f"{cell.method.name} needs expert actions, and the demonstrations of {cell.task.name} have none.",
            "Leave the method or the task out: --methods, --tasks.",
        )


GPU_DEVICES = tuple(map(Path, ("/dev/nvidiactl", "/dev/nvhost-ctrl", "/dev/kfd", "/dev/dxg")))
"""Devices of GPUs that are on no PCI bus, or that a driver has already opened."""
PCI = Path("/sys/bus/pci/devices")
GPU_VENDORS = {"0x10de", "0x1002"}


def cuda_is_available() -> bool:
    """True if torch finds a GPU; torch is not loaded on a machine that surely has none."""
    if sys.platform == "linux" and PCI.is_dir() and not _may_have_gpu():
        return False
    import torch

    return torch.cuda.is_available()


def _may_have_gpu() -> bool:
    # The vendors on the bus, because a driver makes its devices only when somebody first uses it.
    vendors = (place.joinpath("vendor") for place in PCI.iterdir())
    return any(device.exists() for device in GPU_DEVICES) or any(
        vendor.is_file() and vendor.read_text(encoding="ascii").strip() in GPU_VENDORS for vendor in vendors
    )


def choose_device(name: str, cuda_available: Callable[[], bool]) -> str:
    """The device of that name; ``auto`` is CUDA where there is one.

    Raises:
        UserError: for an unknown name, or CUDA where torch has none.
    """
    if name == "auto":
        return "cuda" if cuda_available() else "cpu"
    if name not in DEVICES:
        raise unknown_name("device", name, ["auto", *DEVICES])
    if name == "cuda" and not cuda_available():
        raise UserError("No CUDA device is available to torch.", "Use --device cpu, or install a CUDA build of torch.")
    return name


def choose_protocol(name: str, device: str) -> tuple[Protocol, str]:
    """The protocol of that name, or for ``auto`` the one that fits the device, and why.

    Raises:
        UserError: for an unknown name.
    """
    if name != "auto":
        return load_protocol(name), ""
    chosen = "paper" if device == "cuda" else "quick"
    return load_protocol(chosen), f"auto: '{chosen}' because the device is {device}"


def _data(suite: Suite, task: Task, protocol: Protocol) -> dict[str, str]:
    offline, expert = requests(suite, task, protocol.recipe_for(task))
    return {"offline": offline.specification.hash, "expert": expert.specification.hash}
