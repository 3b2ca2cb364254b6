"""Fetching one file over HTTP: resumed where it broke off, from the next address where one fails.

Bytes go into ``<name>.part`` beside the target, and only what has been looked at takes the target's name. Two processes
that want one file take turns: the second finds it there.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

import requests
from filelock import FileLock

from lfobench.errors import UserError

MIRROR = "LFOBENCH_MIRROR"
"""Environment variable: addresses of folders, separated by commas, that are asked before a file's own addresses."""
CONNECT_SECONDS, SILENT_SECONDS = 10.0, 30.0
ATTEMPTS = 4
"""Per address, as long as each brings new bytes; one that brings none is the last."""
BLOCK = 2**14
"""Of a connection that breaks, the bytes of a block that is not whole are lost."""

Report = Callable[[int, int | None], None]
"""Called with the bytes that are here and, where the host says so, how many there will be."""


class _Failed(Exception):
    """Why an address did not give the file."""


@dataclass(frozen=True)
class Fetched:
    """A file that arrived.

    Attributes:
        path: where it lies.
        address: that gave it; empty where another process had fetched it already.
    """

    path: Path
    address: str


def fetch(name: str, addresses: Sequence[str], target: Path, look: Callable[[Path], None], report: Report) -> Fetched:
    """Fetch a file, unless it is there.

    Args:
        name: what it is called, for messages.
        addresses: of the file, in order; mirrors from the environment come before them.
        target: where it is to lie.
        look: raises `UserError` for what must not take the target's name.
        report: told of progress.

    Raises:
        UserError: no address gives it, what they give is not the file, or the disk refuses.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{target}.lock"):
            if target.exists():
                return Fetched(target, "")
            return _from_any(name, list(_mirrored(addresses)), target, look, report)
    except OSError as error:
        raise UserError(
            f"Cannot write {target}: {error.strerror or error}.",
            "Free space, or choose another folder with LFOBENCH_CACHE; the same command continues.",
        ) from error


def _mirrored(addresses: Sequence[str]) -> Iterator[str]:
    file = PurePosixPath(urlsplit(addresses[0]).path).name
    for mirror in os.environ.get(MIRROR, "").split(","):
        if mirror.strip():
            yield f"{mirror.strip().rstrip('/')}/{file}"
    yield from addresses


def _from_any(
    name: str, addresses: Sequence[str], target: Path, look: Callable[[Path], None], report: Report
) -> Fetched:
    partial = target.with_name(f"{target.name}.part")
    tried = []
    for address in addresses:
        try:
            _from_one(address, partial, report)
            look(partial)
        except _Failed as failure:
            tried.append(f"{address}: {failure}")
        except UserError as refusal:
            partial.unlink(missing_ok=True)
            tried.append(f"{address}: {refusal.problem.rstrip('.')}")
        else:
            partial.replace(target)
            _marker(partial).unlink(missing_ok=True)
            return Fetched(target, address)
    raise UserError(
        f"{name} could not be fetched ({'; '.join(tried)}).",
        f"Try again later, set {MIRROR}, put the file at {target} by hand, or use --source generated.",
    )


def _from_one(address: str, partial: Path, report: Report) -> None:
    """Bring all bytes of an address into `partial`."""
    if urlsplit(address).scheme not in ("http", "https"):
        raise _Failed("only http and https addresses are fetched")
    if _marker_of(partial) != address:  # bytes of another address are not continued
        partial.unlink(missing_ok=True)
        _marker(partial).write_text(address, encoding="utf-8")
    for attempt in range(1, ATTEMPTS + 1):
        before = _size(partial)
        try:
            _attempt(address, partial, report)
        except requests.RequestException as error:
            if attempt == ATTEMPTS or _size(partial) <= before:
                raise _Failed(_reason(error)) from error
        else:
            return


def _attempt(address: str, partial: Path, report: Report) -> None:
    here = _size(partial)
    headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={here}-"} if here else {})
    with requests.get(address, headers=headers, stream=True, timeout=(CONNECT_SECONDS, SILENT_SECONDS)) as answer:
        if answer.status_code == requests.codes.requested_range_not_satisfiable:
            partial.unlink()
            raise requests.exceptions.ChunkedEncodingError("the host has another file than before")
        if not answer.ok:
            raise _Failed(f"{answer.status_code} {answer.reason}".strip())
        continued = answer.status_code == requests.codes.partial_content
        if continued and not (answer.headers.get("Content-Range") or "").startswith(f"bytes {here}-"):
            partial.unlink()
            raise requests.exceptions.ChunkedEncodingError("the host continues from another place than was asked")
        total = _total(answer, here if continued else 0)
        with partial.open("ab" if continued else "wb") as file:
            for block in answer.iter_content(BLOCK):
                file.write(block)
                report(file.tell(), total)
            file.flush()
            os.fsync(file.fileno())
    if total is not None and _size(partial) != total:
        raise requests.exceptions.ConnectionError(f"{_size(partial):,} of {total:,} bytes came")


def _total(answer: requests.Response, before: int) -> int | None:
    length = answer.headers.get("Content-Length", "")
    return before + int(length) if length.isdigit() else None


def _reason(error: requests.RequestException) -> str:
    """What went wrong, in a few words."""
    if isinstance(error, requests.Timeout):
        return "the host does not answer"
    if isinstance(error, requests.TooManyRedirects):
        return "the host sends us in circles"
    if isinstance(error, requests.exceptions.ConnectionError) and "resolve" in str(error):
        return "no network, or no host of that name"
    if isinstance(error, requests.exceptions.ChunkedEncodingError):
        return f"the connection broke off ({_short(error)})"
    return _short(error)


def _short(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= 100 else f"{text[:97]}..."


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _marker(partial: Path) -> Path:
    return partial.with_name(f"{partial.name}.from")


def _marker_of(partial: Path) -> str:
    try:
        return _marker(partial).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""
