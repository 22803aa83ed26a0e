"""Fetching data sets from a server that drops connections, ignores ranges, and serves what it should not."""

import gzip
import hashlib
import io
import json
import os
import stat
import threading
import types
import zipfile
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pooch
import pytest
from test_bvh import CHAIN

import motionkit as mk
from motionkit.datasets import captures, download

CLIPS = [f"data/dataset-2_walk_elderly_{take:03d}" for take in range(1, 6)]
FILES = {f"{clip}.bvh": CHAIN.replace("5 6 7", f"{n} 6 7").encode() for n, clip in enumerate(CLIPS)}
FILES |= {f"{clip}.json": b'{"content": 0, "style": 1}' for clip in CLIPS}
FILES |= {"LICENSE": os.urandom(50_000).hex().encode()}


def fails(message: str):
    return pytest.raises(mk.MotionKitError, match=message)


def packed(files: dict[str, bytes], prefix: str = "repo-1/dataset/") -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("repo-1/README.md", "more is in it than is wanted")
        for place, data in files.items():
            archive.writestr(prefix + place, data)
    return target.getvalue()


class Server(ThreadingHTTPServer):
    """Sends `body`; for each request takes the next number of `drops`, after which many bytes it hangs up."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answer)
        self.body, self.drops, self.ranges, self.length, self.status = packed(FILES), [], True, True, []
        self.moved, self.asked = False, []
        self.address = f"http://127.0.0.1:{self.server_port}/a.zip"


class Answer(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        server, asked = self.server, self.headers.get("Range")
        server.asked.append(asked)
        if server.status:
            return self.send_error(server.status.pop(0))
        if server.moved and self.path == "/a.zip":
            self.send_response(302)
            self.send_header("Location", "/b.zip")
            self.send_header("Content-Length", "0")
            return self.end_headers()
        start = int(asked.removeprefix("bytes=").rstrip("-")) if asked and server.ranges else 0
        if start >= len(server.body):
            self.send_response(416)
            self.send_header("Content-Range", f"bytes */{len(server.body)}")
            return self.end_headers()
        self.send_response(206 if start else 200)
        if start:
            shift = 7 if server.ranges == "wrong" else 0
            self.send_header("Content-Range", f"bytes {start + shift}-{len(server.body) - 1}/{len(server.body)}")
        if server.length:
            self.send_header("Content-Length", str(len(server.body) - start))
        self.end_headers()
        rest = server.body[start:]
        self.wfile.write(rest[: server.drops.pop(0)] if server.drops else rest)

    def log_message(self, *_) -> None:
        pass


@pytest.fixture
def server():
    server = Server()
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture
def waits(monkeypatch) -> list[float]:
    waits: list[float] = []
    monkeypatch.setattr(download, "time", types.SimpleNamespace(sleep=waits.append))
    return waits


@pytest.fixture(autouse=True)
def small(tmp_path, monkeypatch, server, waits):
    """A manifest of a few files, whose archive the server has."""
    about = {"licence": "CC BY-NC 4.0", "terms": "not for sale.", "owner": "(c) somebody", "cite": "them"}
    files = {place: (len(data), hashlib.sha256(data).hexdigest()) for place, data in FILES.items()}
    told = {"name": "bandai-2", "address": server.address, "folder": "dataset", "about": about, "files": files}
    (tmp_path / "manifests").mkdir()
    (tmp_path / "manifests" / "bandai-2.json.gz").write_bytes(gzip.compress(json.dumps(told).encode()))
    monkeypatch.setattr(download, "MANIFESTS", tmp_path / "manifests")
    monkeypatch.setattr(download, "_PIECE", 1000)
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("MOTIONKIT_DATA", raising=False)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def whole(target: Path) -> None:
    found = {p.relative_to(target).as_posix(): p.read_bytes() for p in target.rglob("*") if p.is_file()}
    record = json.loads(found.pop("source.json"))
    assert found == FILES and left(target.parent) == [target.name]
    assert (record["name"], record["licence"], record["files"]) == ("bandai-2", "CC BY-NC 4.0", len(FILES))


def test_fetched_data_are_found(server, tmp_path, capsys):
    target = download.fetch("bandai-2")
    assert target == tmp_path / "cache" / "captures" / "bandai-2"
    whole(target)
    told = capsys.readouterr().out
    assert "CC BY-NC 4.0: not for sale." in told and "(c) somebody; please cite them." in told
    assert [item.name for item in captures.bandai_items("bandai-2")] == [clip.removeprefix("data/") for clip in CLIPS]
    assert download.fetch("bandai-2") == target and len(server.asked) == 1


def test_fetched_where_told_to(server, tmp_path, monkeypatch):
    whole(download.fetch("bandai-2", tmp_path / "a" / "b"))
    monkeypatch.setenv("MOTIONKIT_DATA", str(tmp_path / "c"))
    whole(download.fetch("bandai-2"))
    assert len(captures.bandai_items("bandai-2")) == len(CLIPS) and (tmp_path / "c" / "bandai-2").is_dir()


def test_a_dropped_download_goes_on(server, waits, tmp_path):
    server.drops = [10_000, 0, 5_000]
    whole(download.fetch("bandai-2", tmp_path / "x"))
    assert server.asked == [None, "bytes=10000-", "bytes=10000-", "bytes=15000-"]
    assert waits == [1, 2, 1]


def test_a_server_without_ranges_starts_again(server, waits, tmp_path):
    server.ranges, server.drops = False, [10_000, 8_000, 20_000]
    whole(download.fetch("bandai-2", tmp_path / "x"))
    assert server.asked == [None, "bytes=10000-", "bytes=8000-", "bytes=20000-"] and waits == [1, 2, 1]


def test_a_server_that_sends_another_part(server, tmp_path):
    server.ranges, server.drops = "wrong", [10_000]
    whole(download.fetch("bandai-2", tmp_path / "x"))
    assert server.asked == [None, "bytes=10000-", None]


def test_a_redirect_keeps_what_has_come(server, tmp_path):
    server.moved, server.drops = True, [10_000]
    whole(download.fetch("bandai-2", tmp_path / "x"))
    assert server.asked == [None, None, "bytes=10000-", "bytes=10000-"]


def test_a_busy_server_is_asked_again(server, waits, tmp_path):
    server.status = [503, 429, 500]
    whole(download.fetch("bandai-2", tmp_path / "x"))
    assert waits == [1, 2, 4]


def test_a_download_given_up_goes_on_at_the_next_call(server, waits, tmp_path):
    server.drops = [10_000, 0, 0, 0, 0]
    with fails(r"a.zip: the download stopped after 0.0 MB, and 5 tries in a row brought no more .*call fetch again"):
        download.fetch("bandai-2", tmp_path / "x")
    assert waits == [1, 2, 4, 8] and left(tmp_path / "x") == [".bandai-2.zip.part"]
    whole(download.fetch("bandai-2", tmp_path / "x"))
    assert server.asked[-1] == "bytes=10000-"


def test_a_short_answer_is_noticed_by_its_length(tmp_path, monkeypatch):
    """Older versions of urllib3 end such an answer without a word."""
    answer = types.SimpleNamespace(status_code=200, reason="OK", is_redirect=False, headers={"Content-Length": "10"})

    class Short:
        def __init__(self, *_, hooks, **__):
            self.begin = hooks["response"]

        def __call__(self, address, file, _):
            self.begin(answer)
            file.write(b"four")

    monkeypatch.setattr(pooch, "HTTPDownloader", Short)
    with pytest.raises(download._Broken, match="4 of 10 bytes came"):
        download._continue("a.zip", tmp_path / "part")
    answer.status_code, answer.headers = 206, {"Content-Length": "4", "Content-Range": "bytes 4-7/8"}
    download._continue("a.zip", tmp_path / "part")
    assert (tmp_path / "part").read_bytes() == b"fourfour"


def test_a_part_that_is_whole_or_of_something_else(server, tmp_path):
    for content in (server.body, server.body + b"more"):
        (tmp_path / "x").mkdir(exist_ok=True)
        (tmp_path / "x" / ".bandai-2.zip.part").write_bytes(content)
        whole(download.fetch("bandai-2", tmp_path / "x"))
        (tmp_path / "x" / "bandai-2").rename(tmp_path / "first")
        (tmp_path / "first").rename(tmp_path / f"done{len(content)}")


@pytest.mark.parametrize("status", [403, 404])
def test_a_server_that_refuses(server, waits, tmp_path, status):
    server.status = [status]
    with fails(f"a.zip: the server answered {status} .*open the address in a browser"):
        download.fetch("bandai-2", tmp_path / "x")
    assert waits == [] and left(tmp_path / "x") == []


def test_no_server_at_all(server, tmp_path):
    with fails("the download stopped after 0.0 MB, and 5 tries"):
        download.fetch("bandai-2", tmp_path / "x", address="http://127.0.0.1:1/a.zip")
    with fails("nowhere: cannot be downloaded: .*mend the address"):
        download.fetch("bandai-2", tmp_path / "x", address="nowhere")
    assert left(tmp_path / "x") == []


def link(place: str) -> bytes:
    target = io.BytesIO(packed({p: d for p, d in FILES.items() if p != place}))
    with zipfile.ZipFile(target, "a") as archive:
        info = zipfile.ZipInfo(f"repo-1/dataset/{place}")
        info.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(info, "/etc/passwd")
    return target.getvalue()


def corrupt() -> bytes:
    body = packed(FILES)
    place = body.index(b"LICENSE") + 1000
    return body[:place] + b"\0" * 100 + body[place + 100 :]


WRONG = {
    "cut short": (packed(FILES)[:-200], "no whole zip archive"),
    "a page": (b"<html>please log in</html>", "no whole zip archive"),
    "corrupt": (corrupt(), "no whole zip archive|SHA-256 is another"),
    "other bytes": (
        packed(FILES | {f"{CLIPS[0]}.json": b'{"content": 9, "style": 1}'}),
        "001.json is not the published file",
    ),
    "longer": (
        packed(FILES | {f"{CLIPS[0]}.json": b" " * 10**7}),
        "001.json has 10000000 bytes in the archive; expected 26",
    ),
    "one missing": (packed({p: d for p, d in FILES.items() if p != "LICENSE"}), "the archive has no dataset/LICENSE"),
    "nothing": (packed({}), "the archive has no dataset/"),
    "climbing": (packed(FILES | {"../../../../evil.txt": b""}), "evil.txt', which leads out of its folder"),
    "climbing by \\": (packed(FILES | {"..\\..\\evil.txt": b""}), "which leads out of its folder"),
    "absolute": (packed(FILES, "/repo-1/dataset/"), "which leads out of its folder"),
    "a drive": (packed(FILES, "C:/dataset/"), "which leads out of its folder"),
    "a link": (link("LICENSE"), "LICENSE is a link in the archive; expected a file"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_not_the_published_archive(server, tmp_path, kind):
    body, message = WRONG[kind]
    server.body, server.length = body, kind != "cut short"  # without a length nobody notices that the end is missing
    before = set(tmp_path.rglob("*"))
    with fails(f"bandai-2: .*({message}).*fetch again"):
        download.fetch("bandai-2", tmp_path / "x")
    assert set(tmp_path.rglob("*")) - before == {tmp_path / "x"}
    server.body, server.length = packed(FILES), True
    whole(download.fetch("bandai-2", tmp_path / "x"))


def test_a_size_that_lies(server, tmp_path):
    """The listing says 26 bytes; unpacked it would be ten million."""
    bomb = packed(FILES | {f"{CLIPS[0]}.json": b" " * 10**7})
    server.body = bomb.replace((10**7).to_bytes(4, "little"), (26).to_bytes(4, "little"))
    with fails("bandai-2: .*(no whole zip archive|SHA-256 is another)"):
        download.fetch("bandai-2", tmp_path / "x")
    assert left(tmp_path / "x") == []


def test_an_interrupted_unpacking_is_made_good(server, tmp_path, monkeypatch):
    real = download._copy

    def interrupted(*args):
        if args[2].name.endswith("003.json"):
            raise KeyboardInterrupt
        real(*args)

    monkeypatch.setattr(download, "_copy", interrupted)
    with pytest.raises(KeyboardInterrupt):
        download.fetch("bandai-2", tmp_path / "x")
    assert left(tmp_path / "x") == [".bandai-2.zip"]
    (tmp_path / "x" / ".bandai-2.unpacking" / "data").mkdir(parents=True)  # as if the machine had gone down
    monkeypatch.setattr(download, "_copy", real)
    whole(download.fetch("bandai-2", tmp_path / "x"))
    assert len(server.asked) == 1


def test_data_that_are_there_but_not_whole(server, tmp_path):
    target = download.fetch("bandai-2", tmp_path / "x")
    (target / f"{CLIPS[1]}.bvh").write_bytes(b"short")
    with fails(
        f"002.bvh: expected {len(FILES[CLIPS[1] + '.bvh'])} bytes, as published; found 5 bytes; move .* out of the way"
    ):
        download.fetch("bandai-2", tmp_path / "x")
    (target / f"{CLIPS[1]}.bvh").unlink()
    with fails("002.bvh: expected .* found no such file"):
        download.fetch("bandai-2", tmp_path / "x")


def test_a_place_that_cannot_be(server, tmp_path):
    (tmp_path / "file").write_text("")
    with fails("file: expected a folder to put bandai-2 in; found a file"):
        download.fetch("bandai-2", tmp_path / "file")
    with fails("cannot be written: .*is the folder yours"):
        download.fetch("bandai-2", tmp_path / "file" / "below")
    with fails("cannot fetch 'xia'; this can be fetched: 'bandai-2'"):
        download.fetch("xia")


@pytest.mark.slow
def test_the_manifest_is_that_of_the_archive(captures, monkeypatch, tmp_path):
    import make_manifest

    monkeypatch.undo()
    manifest = download.read_manifest("bandai-2")
    assert make_manifest.files_in(captures) == manifest.files
    assert make_manifest.OUT.stat().st_size < 250_000
    assert make_manifest.COMMIT in manifest.address and manifest.about == make_manifest.ABOUT


def test_the_manifest_lists_every_clip(monkeypatch):
    monkeypatch.undo()
    manifest = download.read_manifest("bandai-2")
    clips = [place for place in manifest.files if place.endswith(".bvh")]
    assert len(clips) == 2902 and all(f"{clip[:-4]}.json" in manifest.files for clip in clips)
    assert {"LICENSE", "cfg/style_label.txt"} < set(manifest.files)
    assert all(place.split("/")[0] in ("LICENSE", "cfg", "data") for place in manifest.files)
