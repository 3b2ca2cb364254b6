"""Fetching one file over HTTP: resumed where it broke off, from the next address where one fails.

HTTPS is tried first, and plain HTTP where nothing else gives the file. The first bytes are checked before the rest is
fetched, and at most the announced size and `MOST_BYTES` are fetched.

Bytes go into ``<name>.part`` next to the target, and only an inspected file takes the target's name. Two processes that
want one file take turns: the second finds it there.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from errno import EACCES, EDQUOT, EFBIG, ENOSPC, EPERM, EROFS
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

import requests
from pydantic import BaseModel

from lfobench.data.isolated import DataFileRefused
from lfobench.errors import UserError
from lfobench.files import Held, cannot_delete, locked
from lfobench.text import shown

NO_ADDRESS = "it is no address, or leads to none"


class Broken(requests.RequestException):
    """An incomplete attempt, with its cause as a clause; the next attempt may fetch the rest."""


def reason(error: requests.RequestException) -> str:
    """Cause of a failed request as a short clause, in place of the library's own message."""
    known = (
        (Broken, str(error)),
        (requests.Timeout, "the host does not answer"),
        (requests.TooManyRedirects, "the host sends us in circles"),
        (requests.exceptions.InvalidSchema, "it leads to an address that is neither http nor https"),
        (requests.exceptions.SSLError, "there is no secure connection to the host"),
        (requests.exceptions.ProxyError, "the proxy gives no connection"),
        (requests.exceptions.ChunkedEncodingError, "the connection broke off"),
        (requests.exceptions.ContentDecodingError, "what the host sends cannot be decoded"),
        (requests.exceptions.InvalidURL, NO_ADDRESS),
    )
    for kind, cause in known:
        if isinstance(error, kind):
            return cause
    text = str(error)
    if "timed out" in text:
        return "the host does not answer"
    if "resolve" in text:
        return "no network, or no host of that name"
    return "the host refuses the connection" if "refused" in text else "there is no connection to the host"


def disk_remedy(error: OSError) -> str:
    """Remedy for an error of the disk."""
    elsewhere = "choose another folder with LFOBENCH_CACHE"
    if error.errno in (ENOSPC, EDQUOT, EFBIG):
        return f"Free space, or {elsewhere}; the same command continues."
    if error.errno in (EACCES, EPERM, EROFS):
        return f"Make the folder writable, or {elsewhere}."
    return f"Fix the folder, or {elsewhere}."


MIRROR = "LFOBENCH_MIRROR"
"""Environment variable: addresses of folders, separated by commas, that are tried before a file's own addresses."""
OPTION = "LFOBENCH_CACHE"
CONNECT_SECONDS, SILENT_SECONDS = 10.0, 30.0
ATTEMPTS = 4
"""Attempts per address; one that brings no new bytes is the last."""
MOST_BYTES = 20 * 10**9
"""Size limit of a file; the largest of D4RL's that a suite reads has less than a twentieth."""
START = 512
"""First bytes, which identify the kind of a file."""
BLOCK = 2**14
"""Bytes per block; an incomplete block is lost when the connection breaks."""

Report = Callable[[int, int | None], None]
"""Callback of progress: bytes fetched and, where the host announces it, the total."""

Begins = Callable[[bytes], str]
"""Check of the first bytes: the reason to refuse the file, or an empty text."""


class _Failed(Exception):
    """Failure of an address, with its cause."""


class _Origin(BaseModel):
    """Origin of a partial file's bytes, so that only bytes of the same file are appended."""

    address: str
    validator: str = ""
    total: int | None = None


@dataclass(frozen=True)
class Fetched:
    """A file that arrived.

    Attributes:
        path: of the file.
        address: its origin; empty where another process had fetched it already.
    """

    path: Path
    address: str


def fetch(
    name: str, addresses: Sequence[str], target: Path, begins: Begins, inspect: Callable[[Path], None], report: Report
) -> Fetched:
    """Fetch a file, unless it is there.

    Args:
        name: of the file, in messages.
        addresses: of the file, in order; mirrors from the environment come before them.
        target: path of the fetched file.
        begins: check of the first bytes, before the rest is fetched.
        inspect: check of the whole file; raises `DataFileRefused` for one that must not take the target's name.
        report: callback of progress.

    Raises:
        UserError: no address gives it, what they give is not the file, or the disk refuses.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with locked(_lock(target), OPTION, wait=True):
            if target.exists():
                return Fetched(target, "")
            return _from_any(name, list(dict.fromkeys(_tried(addresses))), target, begins, inspect, report)
    except OSError as error:
        raise UserError(f"Cannot write {target}: {error.strerror or error}.", disk_remedy(error)) from error


def fetched(target: Path) -> bool:
    """True if a file, or a part of it, was fetched."""
    return target.exists() or _partial(target).exists()


def discard(target: Path) -> bool:
    """Delete a fetched file, complete or partial; returns whether there was any.

    Raises:
        UserError: another process is fetching it, or the disk refuses.
    """
    if not fetched(target):
        return False
    try:
        with locked(_lock(target), OPTION):
            target.unlink(missing_ok=True)
            _discard_partial(_partial(target))
    except Held as error:
        raise UserError(f"Another process is fetching {target}.", "Wait until it is done, or stop it.") from error
    except OSError as error:
        raise cannot_delete(target, error) from error
    return True


def _tried(addresses: Sequence[str]) -> Iterator[str]:
    """Mirrors as given, then the file's own addresses, all of them over HTTPS first."""
    file = PurePosixPath(addresses[0].partition("?")[0]).name
    for mirror in os.environ.get(MIRROR, "").split(","):
        if mirror.strip():
            yield f"{mirror.strip().rstrip('/')}/{file}"
    yield from map(_secured, addresses)
    yield from addresses


def _secured(address: str) -> str:
    """The address over HTTPS; unchanged where it names a port, which serves one of the two."""
    with suppress(ValueError):
        if (parts := urlsplit(address)).scheme == "http" and parts.port is None:
            return parts._replace(scheme="https").geturl()
    return address


def _from_any(
    name: str,
    addresses: Sequence[str],
    target: Path,
    begins: Begins,
    inspect: Callable[[Path], None],
    report: Report,
) -> Fetched:
    partial = _partial(target)
    failures = []
    for address in addresses:
        try:
            _from_one(address, partial, begins, report)
            inspect(partial)
        except _Failed as failure:
            failures.append(f"{address}: {failure}")
        except DataFileRefused as refusal:
            _discard_partial(partial)
            # The inspected file is deleted; its address remains.
            failures.append(refusal.problem.replace(str(partial), address).rstrip("."))
        else:
            partial.replace(target)
            _discard_partial(partial)
            return Fetched(target, address)
    raise UserError(
        f"{name} could not be fetched ({'; '.join(failures)}).",
        f"Try again later, set {MIRROR}, put the file at {target} by hand, or use --source generated.",
    )


def _from_one(address: str, partial: Path, begins: Begins, report: Report) -> None:
    """Fetch all bytes of an address into `partial`."""
    try:
        scheme = urlsplit(address).scheme
    except ValueError as error:
        raise _Failed(f"it is no address ({error})") from error
    if scheme not in ("http", "https"):
        raise _Failed("only http and https addresses are fetched")
    for attempt in range(1, ATTEMPTS + 1):
        before = _here(partial, address)
        try:
            _attempt(address, partial, begins, report)
        except requests.RequestException as error:
            # Bytes of another file are deleted by now, and the next attempt begins anew.
            now = _here(partial, address)
            if attempt == ATTEMPTS or 0 < now <= before or before == now == 0:
                raise _Failed(reason(error)) from error
        else:
            return


def _attempt(address: str, partial: Path, begins: Begins, report: Report) -> None:
    here, origin = _here(partial, address), _origin(partial)
    headers = {"Accept-Encoding": "identity"}
    if here and origin is not None:
        headers |= {"Range": f"bytes={here}-", "If-Range": origin.validator}
    with _request(address, headers) as answer:
        if address.startswith("https:") and not answer.url.startswith("https:"):
            raise _Failed("it leads to an address without https")
        if answer.status_code == requests.codes.requested_range_not_satisfiable:
            if answer.headers.get("Content-Range", "") == f"bytes */{here}":
                return
            _discard_partial(partial)
            raise Broken("the host has another file than before")
        if not answer.ok:
            raise _Failed(f"{answer.status_code} {shown(answer.reason or '')}".strip())
        continued = answer.status_code == requests.codes.partial_content
        # An encoding was not requested. Lengths and ranges then count bytes before decoding.
        encoded = answer.headers.get("Content-Encoding", "").strip().lower() not in ("", "identity")
        total = None if encoded else _total(answer, here if continued else 0)
        place = answer.headers.get("Content-Range", "")
        if continued and (encoded or not place.startswith(f"bytes {here}-") or origin is None or origin.total != total):
            _discard_partial(partial)
            raise Broken("the host continues another file, or from another place")
        if (total or 0) > MOST_BYTES:
            raise _Failed(_too_large(total))
        if not continued:
            validator = "" if encoded else _validator(answer)
            _write_origin(partial, _Origin(address=address, validator=validator, total=total))
        start = b""
        with partial.open("ab" if continued else "wb") as file:
            for block in answer.iter_content(BLOCK):
                if not continued and len(start) < START:
                    start += block[: START - len(start)]
                    if len(start) == START and (problem := begins(start)):
                        raise _not_wanted(partial, problem)
                file.write(block)
                if file.tell() > MOST_BYTES:
                    raise _not_wanted(partial, _too_large())
                report(file.tell(), total)
            file.flush()
            os.fsync(file.fileno())
    if total is not None and _size(partial) != total:
        raise Broken(f"{_size(partial):,} of {total:,} bytes came")


def _request(address: str, headers: dict[str, str]) -> requests.Response:
    try:
        return requests.get(address, headers=headers, stream=True, timeout=(CONNECT_SECONDS, SILENT_SECONDS))
    except requests.RequestException:
        raise
    except ValueError as error:  # of a redirect, where requests does not wrap it
        raise _Failed(NO_ADDRESS) from error


def _total(answer: requests.Response, before: int) -> int | None:
    length = answer.headers.get("Content-Length", "")
    return before + int(length) if length.isdigit() else None


def _validator(answer: requests.Response) -> str:
    """Validator of this version of the file (RFC 9110, 13.1.5); a weak tag does not qualify."""
    tag = answer.headers.get("ETag", "")
    return answer.headers.get("Last-Modified", "") if not tag or tag.startswith("W/") else tag


def _not_wanted(partial: Path, why: str) -> _Failed:
    """Error for bytes that do not belong to the file; deletes them."""
    _discard_partial(partial)
    return _Failed(why)


def _too_large(total: int | None = None) -> str:
    there = "it goes on" if total is None else f"it has {total / 1e9:,.1f} GB"
    return f"{there}, and at most {MOST_BYTES / 1e9:g} GB are fetched"


def _here(partial: Path, address: str) -> int:
    """Bytes of that address that a further request can continue."""
    origin = _origin(partial)
    return _size(partial) if origin is not None and origin.address == address and origin.validator else 0


def _lock(target: Path) -> Path:
    return target.with_name(f"{target.name}.lock")


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _partial(target: Path) -> Path:
    return target.with_name(f"{target.name}.part")


def _marker(partial: Path) -> Path:
    return partial.with_name(f"{partial.name}.from")


def _write_origin(partial: Path, origin: _Origin) -> None:
    _marker(partial).write_text(origin.model_dump_json(), encoding="utf-8")


def _origin(partial: Path) -> _Origin | None:
    """Origin of the partial file; None where it is unknown."""
    try:
        return _Origin.model_validate_json(_marker(partial).read_bytes())
    except (OSError, ValueError):
        return None


def _discard_partial(partial: Path) -> None:
    for path in (partial, _marker(partial)):
        path.unlink(missing_ok=True)
