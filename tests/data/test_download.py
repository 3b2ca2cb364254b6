"""Downloads from a host that truncates, stalls, redirects, lies and refuses: whole and looked at, or not at all."""

from __future__ import annotations

import errno
import gzip
import io
import json
import os
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from helpers_cli import PATIENCE

from lfobench.data import download
from lfobench.data.download import Fetched, discard, fetch
from lfobench.data.isolated import DataFileRefused
from lfobench.errors import UserError
from lfobench.files import locked

CONTENT = bytes(range(256)) * 400
OTHER = CONTENT[:512] + bytes(39_488)
TAG = '"one"'
Answer = Callable[["Host"], None]


class Host(BaseHTTPRequestHandler):
    """Answers by the path's first part; counts requests, and remembers the ranges that were asked for."""

    asked: list[str]
    over: threading.Event
    sent: dict[str, int]

    def do_GET(self) -> None:
        type(self).asked.append(f"{self.path} {self.headers.get('Range', '')}".strip())
        ANSWERS[self.path.split("/")[1]](self)

    def log_message(self, *_: object) -> None:
        """Silent."""

    @property
    def start(self) -> int:
        return int(self.headers.get("Range", "bytes=0-").removeprefix("bytes=").rstrip("-"))

    def send(self, content: bytes, status: int = 200, **headers: object) -> None:
        self.send_response(status)
        for name, value in ({"Content_Length": len(content), "ETag": TAG} | headers).items():
            self.send_header(name.replace("_", "-"), str(value))
        self.end_headers()
        self.wfile.write(content)

    def continued(self, content: bytes) -> None:
        place = f"bytes {self.start}-{len(CONTENT) - 1}/{len(CONTENT)}"
        self.send(content, 206, Content_Range=place, Content_Length=len(CONTENT) - self.start)

    @property
    def times(self) -> int:
        return sum(line.startswith(self.path) for line in type(self).asked)


def whole(host: Host) -> None:
    host.send(CONTENT)


def breaks_off(host: Host) -> None:
    """Two blocks a time; what is asked to continue continues."""
    piece = CONTENT[host.start : host.start + 32_768]
    if host.start:
        host.continued(piece)
    else:
        host.send(piece, Content_Length=len(CONTENT))


def breaks_off_without_ranges(host: Host) -> None:
    host.send(CONTENT if host.times == 3 else CONTENT[: 20_000 * host.times], Content_Length=len(CONTENT))


def always_short(host: Host) -> None:
    host.send(CONTENT[:1000], Content_Length=len(CONTENT))


def longer_than_said(host: Host) -> None:
    host.send(CONTENT, Content_Length=1000)


def other_place(host: Host) -> None:
    if not host.start:
        host.send(CONTENT[:5000], Content_Length=len(CONTENT))
    elif host.times == 2:
        host.send(CONTENT[:10], 206, Content_Range=f"bytes 0-9/{len(CONTENT)}")


def stalls(host: Host) -> None:
    host.send(CONTENT[:1000], Content_Length=len(CONTENT))
    host.wfile.flush()
    type(host).over.wait()


def changes(host: Host) -> None:
    """Breaks off in one file, and has another one, of the same length, when it is asked to continue."""
    if host.times == 1:
        host.send(OTHER, Content_Length=len(CONTENT), ETag='"old"')
    elif host.headers.get("If-Range") == TAG:
        host.continued(CONTENT[host.start :])
    else:
        host.send(CONTENT)


def longer_now(host: Host) -> None:
    """Continues what it should not: the same tag, another length."""
    if host.times == 1:
        host.send(OTHER, Content_Length=len(CONTENT) + 7)
    elif host.start:
        host.continued(CONTENT[host.start :])
    else:
        host.send(CONTENT)


def complete(host: Host) -> None:
    """There is nothing behind the last byte."""
    host.send(b"", 416, Content_Range=f"bytes */{len(CONTENT)}")


def redirects(host: Host) -> None:
    host.send(b"", 302, Location="/whole/file")


def in_circles(host: Host) -> None:
    host.send(b"", 302, Location=host.path)


def compressed(host: Host) -> None:
    """Though nobody asked for it."""
    host.send(gzip.compress(CONTENT), Content_Encoding="gzip")


def badly_compressed(host: Host) -> None:
    host.send(b"not compressed", Content_Encoding="gzip")


def endless(host: Host) -> None:
    """Of another kind, or without a length, until nobody listens any more."""
    host.send_response(200)
    host.end_headers()
    other = bytes(4096) if host.path.endswith("zeros") else CONTENT
    try:
        while True:
            host.wfile.write(other)
            host.sent[host.path] = host.sent.get(host.path, 0) + len(other)
    except OSError:
        host.over.set()


def huge(host: Host) -> None:
    host.send(CONTENT, Content_Length=30 * 10**9)


def odd_words(host: Host) -> None:
    host.send_response(503, "\x1b[2J" + "a" * 3_000)
    host.end_headers()


def page(host: Host) -> None:
    host.send(b"<html>Log in</html>")


ANSWERS: dict[str, Answer] = {
    "whole": whole,
    "breaks-off": breaks_off,
    "no-ranges": breaks_off_without_ranges,
    "always-short": always_short,
    "longer": longer_than_said,
    "other-place": other_place,
    "stalls": stalls,
    "redirects": redirects,
    "changes": changes,
    "longer-now": longer_now,
    "complete": complete,
    "circles": in_circles,
    "compressed": compressed,
    "badly-compressed": badly_compressed,
    "odd-words": odd_words,
    "to-a-file": lambda host: host.send(b"", 302, Location="file:///etc/passwd"),
    "to-nowhere": lambda host: host.send(b"", 302, Location="http://[::1/file"),
    "page": page,
    "endless": endless,
    "huge": huge,
    "403": lambda host: host.send(b"no", 403),
    "404": lambda host: host.send(b"no", 404),
    "500": lambda host: host.send(b"no", 500),
}


@pytest.fixture
def host(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.delenv(download.MIRROR, raising=False)
    Host.asked, Host.over, Host.sent = [], threading.Event(), {}
    server = ThreadingHTTPServer(("127.0.0.1", 0), Host)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    Host.over.set()
    server.shutdown()
    server.server_close()


def inspect(path: Path) -> None:
    if path.read_bytes() != CONTENT:
        raise DataFileRefused(f"{path} is other content.")


def begins(start: bytes) -> str:
    return "" if CONTENT.startswith(start) else f"it begins with {start[:6]!r}"


def get(target: Path, *addresses: str) -> Fetched:
    return fetch("the file", addresses, target, begins, inspect, lambda here, total: None)


def left(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.suffix != ".lock"}


@pytest.mark.parametrize(
    "kind", ["whole", "breaks-off", "no-ranges", "redirects", "changes", "longer-now", "compressed"]
)
def test_what_arrives_in_the_end_is_whole(tmp_path: Path, host: str, kind: str) -> None:
    fetched = get(tmp_path / "file", f"{host}/{kind}/file")
    assert fetched == Fetched(tmp_path / "file", f"{host}/{kind}/file")
    assert (tmp_path / "file").read_bytes() == CONTENT
    assert left(tmp_path) == {"file"}


def test_a_broken_download_continues_where_it_broke(tmp_path: Path, host: str) -> None:
    get(tmp_path / "file", f"{host}/breaks-off/file")
    assert [line.partition(" ")[2] for line in Host.asked] == ["", *(f"bytes={n}-" for n in (32_768, 65_536, 98_304))]


@pytest.mark.parametrize(
    ("kind", "named"),
    [
        ("always-short", r"file: .*broke off\)"),
        ("longer", r"longer/file is other content"),
        ("stalls", r"file: .*not answer\)"),
        ("circles", "in circles"),
        ("page", r"\(http\S*/page/file is other content\)"),
        ("badly-compressed", r"file: .*decoded\)"),
        ("odd-words", r"file: 503 \\x1b\[2Ja{32}…\)"),
        ("to-a-file", r"file: .*neither http nor https\)"),
        ("to-nowhere", r"file: .*address.*\)"),
        ("403", "403 Forbidden"),
        ("404", "404 Not Found"),
        ("500", "500 Internal"),
    ],
)
def test_what_does_not_arrive_takes_no_name(
    tmp_path: Path, host: str, kind: str, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if kind == "stalls":
        monkeypatch.setattr(download, "SILENT_SECONDS", 0.3)
    with pytest.raises(UserError, match=named) as caught:
        get(tmp_path / "file", f"{host}/{kind}/file")
    assert caught.value.problem.startswith("the file ")
    for remedy in ("LFOBENCH_MIRROR", str(tmp_path / "file"), "--source generated"):
        assert remedy in caught.value.remedy
    assert ".part" not in caught.value.problem
    assert "file" not in left(tmp_path)


def test_a_continuation_from_another_place_is_not_appended(tmp_path: Path, host: str) -> None:
    with pytest.raises(UserError):
        get(tmp_path / "file", f"{host}/other-place/file")
    assert "file" not in left(tmp_path)


def test_the_next_address_is_tried_and_starts_anew(tmp_path: Path, host: str) -> None:
    fetched = get(tmp_path / "file", f"{host}/404/file", f"{host}/always-short/file", f"{host}/whole/file")
    assert fetched.address == f"{host}/whole/file"
    assert Host.asked[-1] == "/whole/file"


def test_mirrors_are_asked_first(tmp_path: Path, host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(download.MIRROR, f"{host}/404/deep/, {host}/whole")
    assert get(tmp_path / "file", f"{host}/403/the-file.hdf5").address == f"{host}/whole/the-file.hdf5"
    assert Host.asked == ["/404/deep/the-file.hdf5", "/whole/the-file.hdf5"]


def test_what_is_there_is_not_fetched(tmp_path: Path, host: str) -> None:
    (tmp_path / "file").write_bytes(b"here")
    assert get(tmp_path / "file", f"{host}/whole/file") == Fetched(tmp_path / "file", "")
    assert Host.asked == []


def interrupted(folder: Path, size: int, address: str, validator: str = TAG) -> None:
    """What a command leaves that is killed after so many bytes."""
    (folder / "file.part").write_bytes(CONTENT[:size])
    origin = {"address": address, "validator": validator, "total": len(CONTENT)}
    (folder / "file.part.from").write_text(json.dumps(origin))


def test_an_interrupted_download_is_continued_by_the_next_command(tmp_path: Path, host: str) -> None:
    interrupted(tmp_path, 40_000, f"{host}/breaks-off/file")
    get(tmp_path / "file", f"{host}/breaks-off/file")
    assert Host.asked[0] == "/breaks-off/file bytes=40000-"
    assert left(tmp_path) == {"file"}


def test_what_nobody_can_know_again_is_fetched_anew(tmp_path: Path, host: str) -> None:
    interrupted(tmp_path, 40_000, f"{host}/breaks-off/file", validator="")
    get(tmp_path / "file", f"{host}/breaks-off/file")
    assert Host.asked[0] == "/breaks-off/file"


def test_all_bytes_are_there_already(tmp_path: Path, host: str) -> None:
    interrupted(tmp_path, len(CONTENT), f"{host}/complete/file")
    get(tmp_path / "file", f"{host}/complete/file")
    assert Host.asked == [f"/complete/file bytes={len(CONTENT)}-"]


def test_what_stands_in_the_way_of_looking_costs_no_byte(tmp_path: Path, host: str) -> None:
    def cannot(_: Path) -> None:
        raise UserError("The simulator is not installed.", "Install it.")

    with pytest.raises(UserError, match="The simulator"):
        fetch("the file", [f"{host}/whole/file"], tmp_path / "file", begins, cannot, lambda here, total: None)
    assert (tmp_path / "file.part").read_bytes() == CONTENT


def test_bytes_of_another_address_are_not_continued(tmp_path: Path, host: str) -> None:
    interrupted(tmp_path, 40_000, "http://elsewhere/file")
    get(tmp_path / "file", f"{host}/breaks-off/file")
    assert (tmp_path / "file").read_bytes() == CONTENT


def test_two_that_want_one_file_fetch_it_once(tmp_path: Path, host: str) -> None:
    found: list[Fetched] = []
    threads = [
        threading.Thread(target=lambda: found.append(get(tmp_path / "file", f"{host}/breaks-off/file")))
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    assert sorted(each.address for each in found) == ["", f"{host}/breaks-off/file"]
    assert len(Host.asked) == 4


def test_what_was_fetched_is_deleted_but_not_under_another_process(tmp_path: Path) -> None:
    target = tmp_path / "file"
    assert not discard(target)
    interrupted(tmp_path, 40_000, "http://elsewhere/file")
    with (
        locked(Path(f"{target}.lock"), "LFOBENCH_CACHE"),
        pytest.raises(UserError, match=rf"Another process .*{target}"),
    ):
        discard(target)
    assert (tmp_path / "file.part").exists()
    assert discard(target)
    assert not left(tmp_path)


# --- what is not wanted is not fetched -------------------------------------------------------------------------------


def test_the_first_bytes_are_looked_at_before_the_rest_comes(tmp_path: Path, host: str) -> None:
    """The host would send zeros for ever."""
    with pytest.raises(UserError, match=r"endless/zeros: it begins with b'\\x00"):
        get(tmp_path / "file", f"{host}/endless/zeros")
    assert left(tmp_path) == set()


def test_no_more_comes_than_the_stated_maximum(tmp_path: Path, host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(download, "MOST_BYTES", 1_000_000)
    with pytest.raises(UserError, match=r"0\.001 GB"):
        get(tmp_path / "file", f"{host}/endless/file")
    assert Host.over.wait(PATIENCE), "the connection is closed"
    assert left(tmp_path) == set()


def test_a_declared_size_beyond_the_maximum_is_refused_at_once(tmp_path: Path, host: str) -> None:
    with pytest.raises(UserError, match=r"30\.0 GB.* 20 GB"):
        get(tmp_path / "file", f"{host}/huge/file")
    assert len(Host.asked) == 1
    assert left(tmp_path) == set()


@pytest.mark.parametrize("mirror", [None, "http://mirror.example/files"])
def test_https_is_asked_before_http(mirror: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mirror is the user's own word; a port speaks one of the two."""
    asked: list[str] = []

    def refuse(address: str, **_: object) -> None:
        asked.append(address)
        raise download.requests.ConnectionError("refused")

    monkeypatch.delenv(download.MIRROR, raising=False)
    if mirror:
        monkeypatch.setenv(download.MIRROR, mirror)
    monkeypatch.setattr(download.requests, "get", refuse)
    with pytest.raises(UserError):
        get(tmp_path / "file", "http://one.example/a/file", "https://two.example/file", "http://three.example:80/file")
    assert asked == [
        *([f"{mirror}/file"] if mirror else []),
        "https://one.example/a/file",
        "https://two.example/file",
        "http://three.example:80/file",
        "http://one.example/a/file",
    ]


def test_an_address_that_does_not_answer_costs_no_byte_of_another(tmp_path: Path, host: str) -> None:
    """HTTPS is tried first each time; the half that came over HTTP is continued all the same."""
    interrupted(tmp_path, 40_000, f"{host}/breaks-off/file")
    get(tmp_path / "file", "http://127.0.0.1:9/file", f"{host}/breaks-off/file")
    assert Host.asked[0] == "/breaks-off/file bytes=40000-"


def test_https_that_leads_to_http_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = download.requests.Response()
    answer.status_code, answer.url, answer.raw = 200, "http://one.example/file", io.BytesIO(CONTENT)
    monkeypatch.setattr(download.requests, "get", lambda address, **_: answer)
    with pytest.raises(UserError, match="without https"):
        get(tmp_path / "file", "https://one.example/file")
    assert left(tmp_path) == set()


def test_without_a_network(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"\(http://127.0.0.1:9/file: .*refuses.*\)"):
        get(tmp_path / "file", "http://127.0.0.1:9/file")


@pytest.mark.parametrize("address", ["file:///etc/passwd", "ftp://host/file", "http://[::1/file"])
def test_only_http_is_fetched(tmp_path: Path, address: str) -> None:
    with pytest.raises(UserError, match=r"http and https|no address"):
        get(tmp_path / "file", address)


@pytest.mark.parametrize(
    ("code", "named"),
    [
        (errno.ENOSPC, "No space left on device.*Free space"),
        (errno.EACCES, "Permission denied.*writable"),
        (errno.EIO, "Input/output error"),
    ],
)
def test_a_disk_that_refuses(tmp_path: Path, host: str, monkeypatch: pytest.MonkeyPatch, code: int, named: str) -> None:
    def refuse(_: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(download.os, "fsync", refuse)
    with pytest.raises(UserError, match=rf"{tmp_path}/file: {named}.*LFOBENCH_CACHE"):
        get(tmp_path / "file", f"{host}/whole/file")
    assert "file" not in left(tmp_path)
