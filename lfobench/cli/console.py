"""The two consoles: results go to standard output, everything else to standard error.

Whatever is printed, names of other people's records among it, reaches a terminal only through here: what a terminal
would obey is escaped, and a character that the terminal's encoding lacks is spelled in those that it has.
"""

from __future__ import annotations

import codecs
import io
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from lfobench.errors import UserError
from lfobench.text import harmless, harmless_lines


class _Console(Console):
    """A console that escapes what a terminal would obey, wherever it comes from; styles are its own."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(harmless_lines(segment.text), segment.style)

    def print(self, *objects: Any, **how: Any) -> None:
        # A number that is wider than the terminal is broken by it, not cut.
        super().print(*objects, **{"crop": False, **how})

    def out(self, *objects: Any, **how: Any) -> None:
        super().out(*(harmless_lines(str(each)) for each in objects), **how)


output = _Console(highlight=False, emoji=False)
errors = _Console(stderr=True, highlight=False, emoji=False)

INTERRUPTED = 130
"""Exit code of what the user stopped."""

LEFT = 3
"""Exit code of ``--no-wait`` where runs are left to another process."""

_SPELLED = {
    "±": "+-",
    "−": "-",
    "–": "-",
    "─": "-",
    "·": "*",
    "…": "...",
    "→": "->",
    "≈": "~",
    "∼": "~",
    "≠": "!=",
    "✗": "x",
    "†": "+",
    "§": "S",
    "¶": "P",
    "α": "alpha",
    "τ": "tau",
    "χ": "chi",
    "²": "^2",
}
"""Our own signs in ASCII; any other character becomes ``\\u00e9``, which JSON reads, too."""

_SPELLING = "lfobench"


def print_json(value: Any) -> None:
    """`value` as JSON on standard output, for scripts."""
    output.out(json.dumps(value, indent=2, default=str), highlight=False)


def one_line(text: str) -> str:
    """`text` without line breaks, shown as it is written: its brackets are no markup, its control codes do nothing."""
    from rich.markup import escape

    return escape(harmless(text))


def duration(seconds: float) -> str:
    """``5 s``, ``12 min``, ``3.4 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


@contextmanager
def guarded_streams() -> Iterator[None]:
    """Inside the block, standard output that cannot be written is a user's mistake, and every character is printed.

    Standard error that cannot be written is done without: nobody's training stops because its log has no reader.

    Raises:
        UserError: standard output cannot be written, as on a full disk or into a pipe that nobody reads.
    """
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _guarded(sys.stdout, _refuse), _guarded(sys.stderr, lambda error: None)
    try:
        yield
        _flush()
    except SystemExit:
        # The usual end of a command; what it wrote last may still wait to be written.
        _flush()
        raise
    finally:
        sys.stdout, sys.stderr = before


def _flush() -> None:
    # There is no stream at all where the shell closed it.
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()


def _refuse(error: OSError) -> None:
    raise UserError(
        f"Standard output cannot be written: {error.strerror or error}.", "Send it where there is room and a reader."
    ) from error


def _guarded(stream: TextIO, failed: Callable[[OSError], None]) -> TextIO:
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    try:
        stream.fileno()
    except OSError:  # It is no file: somebody collects in memory what is written.
        return stream
    stream.flush()
    raw = getattr(stream.buffer, "raw", stream.buffer)
    return io.TextIOWrapper(
        io.BufferedWriter(_Sink(raw, failed)),
        encoding=stream.encoding,
        errors=_SPELLING,
        line_buffering=stream.line_buffering,
    )


class _Sink(io.RawIOBase):
    """A file that says once that it cannot be written, and then lets everything go."""

    def __init__(self, file: Any, failed: Callable[[OSError], None]) -> None:
        self._file, self._failed, self._lost = file, failed, False

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return int(self._file.fileno())

    def isatty(self) -> bool:
        return bool(self._file.isatty())

    def write(self, content: Any) -> int:
        if not self._lost:
            try:
                return int(self._file.write(content))
            except OSError as error:
                self._lost = True
                self._failed(error)
        return len(content)


def _spell(error: UnicodeError) -> tuple[str, int]:
    """Replacement of characters that the encoding of a stream lacks."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end]
    return "".join(_SPELLED.get(each) or _escaped(each) for each in characters), error.end


def _escaped(character: str) -> str:
    # In two halves where it takes them, as JSON has it.
    halves = character.encode("utf-16-be", "surrogatepass").hex()
    return "".join(f"\\u{halves[start : start + 4]}" for start in range(0, len(halves), 4))


codecs.register_error(_SPELLING, _spell)
