"""The updates of one stage, as fast as the device takes them: run as they are written, or recorded and replayed.

On CUDA the whole step (choice of rows, losses, optimiser, target update, sums of metrics) becomes one graph per kind of
step, and so does the drawing of a chunk's random numbers; a step is then one launch. The first steps of every kind run
eagerly: they are training steps like any other, and they let libraries set themselves up.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import torch

from lfobench.cells.cell import Precision, effective
from lfobench.contract.method import Method, Stage
from lfobench.data.firewall import View
from lfobench.engine.batches import RunningStep, StageSampler
from lfobench.engine.state import live_tensors, plain_values
from lfobench.randomness import Randomness
from lfobench.record import Warning

if TYPE_CHECKING:
    from torch import Tensor

# As /proc/cpuinfo names them on x86 and on ARM.
BF16_UNITS = ("avx512_bf16", "amx_bf16", "bf16")


@contextmanager
def products(precision: Precision, device: torch.device) -> Iterator[None]:
    """Products of that precision inside the block."""
    kind = effective(precision, device.type)
    if device.type == "cuda":
        torch.backends.cuda.matmul.allow_tf32 = kind == "tf32"
    if kind != "bf16":
        yield
        return
    # Autocast's cache of converted weights would outlive the step that changes them.
    with torch.autocast(device.type, torch.bfloat16, cache_enabled=False):
        yield


def precision_warnings(precision: Precision, device: torch.device) -> list[Warning]:
    """Warnings about a precision on this machine."""
    if precision != "bf16" or device.type != "cpu" or has_bf16_units():
        return []
    return [
        Warning(
            what="This processor has no bf16 matrix units, so bf16 products are emulated.",
            remedy="float32 is faster here.",
        )
    ]


def has_bf16_units() -> bool:
    """True if the processor multiplies bf16 matrices in hardware."""
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8").split()
    except OSError:
        return True
    return any(unit in flags for unit in BF16_UNITS)


WARM_UP = 3
Kind = tuple[int, int]


class Recorder(Protocol):
    """Turns work into something that repeats it without Python."""

    def __call__(self, work: Callable[[], None]) -> Callable[[], None]:
        """Record the operations of `work` without carrying them out; the result carries them out.

        Raises:
            RuntimeError: where an operation cannot be recorded.
        """
        ...


class CudaGraphs:
    """Records CUDA graphs that share one memory pool: replayed one after another, none keeps anything in it.

    They are recorded on the stream they are replayed on. torch has 32 streams and hands them out in turn, so one made
    here could be another job's, whose work would be recorded instead of done.
    """

    _one_at_a_time = threading.Lock()
    _of_the_main_thread: torch.cuda.Stream | None = None

    def __init__(self) -> None:
        self._pool = torch.cuda.graph_pool_handle()

    def __call__(self, work: Callable[[], None]) -> Callable[[], None]:
        """See `Recorder`."""
        graph = torch.cuda.CUDAGraph()
        before = torch.cuda.current_stream()
        # Other threads of this process train other jobs meanwhile: they may wait and allocate, but not record.
        with self._one_at_a_time:
            stream = self._stream(before)
            # A collection could destroy another job's graph, which is not permitted while recording.
            gc.disable()
            try:
                with torch.cuda.graph(graph, pool=self._pool, stream=stream, capture_error_mode="thread_local"):
                    work()
            finally:
                gc.enable()
                # Where recording failed, torch leaves its stream the current one.
                torch.cuda.set_stream(before)
        return graph.replay

    @classmethod
    def _stream(cls, current: torch.cuda.Stream) -> torch.cuda.Stream:
        """The current stream; the default one cannot be recorded, so there is one to stand in for it."""
        if current != torch.cuda.default_stream():
            return current
        if cls._of_the_main_thread is None:
            cls._of_the_main_thread = torch.cuda.Stream()
        return cls._of_the_main_thread


def recorder_for(device: torch.device) -> Recorder | None:
    """CUDA graphs on CUDA; elsewhere steps run as they are written."""
    return CudaGraphs() if device.type == "cuda" else None


class Program:
    """Carries out a stage's updates.

    Args:
        method: what is trained.
        view: the data, behind the firewall.
        stage: one of the method's.
        randomness: of the seeds.
        precision: of matrix products.
        recorder: what records steps; None runs every step eagerly.

    Attributes:
        replayed: updates that were replays.
        problem: why steps are not recorded although they were to be, if so.
    """

    def __init__(
        self,
        method: Method,
        view: View,
        stage: Stage,
        randomness: Randomness,
        *,
        precision: Precision = "auto",
        recorder: Recorder | None = None,
    ) -> None:
        self._method, self._stage, self._precision, self._recorder = method, stage, precision, recorder
        self._device = randomness.device
        self._sampler = StageSampler(view, stage, randomness)
        self._sums: dict[str, Tensor] = {}
        self._eager_steps: dict[Kind, int] = {}
        self._replays: dict[Kind, Callable[[], None]] = {}
        self._before = None if recorder is None else (plain_values(method), live_tensors(method))
        self._refill: tuple[int, Callable[[], None]] | None = None
        self.replayed = 0
        self.problem: Warning | None = None

    def update(self, step: int) -> None:
        """One update; `step` is the number of updates of the stage before it."""
        self._sampler.draws.move_to(step, self._refill_draws)
        kind = (step % self._stage.period, self._sampler.expert_rows(step))
        if kind not in self._replays and self._eager_steps.get(kind, 0) >= WARM_UP:
            self._record(kind)
        if replay := self._replays.get(kind):
            replay()
            self.replayed += 1
        else:
            self._eager_steps[kind] = self._eager_steps.get(kind, 0) + 1
            self._carry_out(kind)

    def metric_sums(self) -> dict[str, Tensor]:
        """Sums of the metrics ``[S]`` over the updates since they were last cleared; live tensors."""
        return dict(self._sums)

    def clear_metrics(self) -> None:
        """Start the sums anew."""
        for total in self._sums.values():
            total.zero_()

    def add_to_metrics(self, sums: dict[str, Tensor]) -> None:
        """Sums of earlier updates, from a checkpoint."""
        self._sums = {name: total.to(self._device).clone() for name, total in sums.items()}

    def _refill_draws(self) -> None:
        draws = self._sampler.draws
        if self._replays and (self._refill is None or self._refill[0] != draws.kinds):
            replay = self._recorded(draws.refill)
            self._refill = None if replay is None else (draws.kinds, replay)
        if self._refill is None:
            draws.refill()
        else:
            self._refill[1]()

    def _carry_out(self, kind: Kind) -> None:
        phase, expert_rows = kind
        draws = self._sampler.draws
        offline, expert = self._sampler.batches(expert_rows)
        with products(self._precision, self._device):
            metrics = self._method.update(self._stage.name, offline, expert, RunningStep(draws, phase))
        for name, value in metrics.items():
            if name in self._sums:
                self._sums[name].add_(value)
            else:
                self._sums[name] = value.clone()
        draws.advance()

    def _record(self, kind: Kind) -> None:
        if self._recorder is not None and (changed := self._changed_in_python()):
            self._recorder = None
            self.problem = Warning(
                what=f"Stage '{self._stage.name}' ran step by step: an update changes '{changed}' in Python.",
                remedy="The numbers hold; only time is lost. Keep what changes in tensors, and change them in place.",
            )
        if replay := self._recorded(lambda: self._carry_out(kind)):
            self._replays[kind] = replay

    def _changed_in_python(self) -> str | None:
        """The name of a plain value or a tensor that the eager steps have replaced: a replay would not replace it."""
        plain, tensors = self._before or ({}, {})
        now = plain_values(self._method)
        changed = [name for name, value in now.items() if name not in plain or plain[name] != value]
        changed += [
            name
            for name, tensor in live_tensors(self._method).items()
            if name in tensors and tensors[name].data_ptr() != tensor.data_ptr()
        ]
        return changed[0] if changed else None

    def _recorded(self, work: Callable[[], None]) -> Callable[[], None] | None:
        if self._recorder is None:
            return None
        try:
            return self._recorder(work)
        except RuntimeError as error:
            self._recorder = None
            cause = _first_cause(error).strip().splitlines()[0]
            self.problem = Warning(
                what=f"Stage '{self._stage.name}' ran step by step: it could not be recorded ({cause}).",
                remedy="The numbers hold; only time is lost.",
            )
            return None


def _first_cause(error: BaseException) -> str:
    """First cause of an error: ending a recording that failed raises an error of its own."""
    while error.__context__ is not None:
        error = error.__context__
    return str(error) or type(error).__name__
