"""Corpora in shards: made in bounded steps, stopped and gone on with, read without loading the whole."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import joblib
import pytest
import torch
from joblib.parallel import ThreadingBackend
from made_clips import Made
from test_bvh import CHAIN

import motionkit as mk
from motionkit.benchmarks.corpus import private_mb
from motionkit.datasets import BvhSource, Corpus, Item, Labels, build_cache
from motionkit.datasets import cache as stores
from motionkit.datasets.sources import File


def listed(count: int, **more) -> list[Item]:
    labels = [
        Labels("walk", f"s{n % 3}", (f"text {n}",), f"p{n // 2 % 2}", f"t{n // 2}", "train") for n in range(count)
    ]
    return [Item(f"clip_{n:03d}", labels[n], Made(n, frames=3 + n, **more)) for n in range(count)]


def same(corpus: Corpus, items: list[Item]) -> None:
    assert [clip.name for clip in corpus] == [item.name for item in items]
    for clip, item in zip(corpus, items, strict=True):
        expected = item.source.read().motion
        assert clip.labels == item.labels and clip.motion.name == item.name
        assert torch.equal(clip.motion.rotations, expected.rotations)
        assert torch.equal(clip.motion.translations, expected.translations)


def dated(folder: Path) -> dict[str, tuple[int, int]]:
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in folder.glob("shard-*")}


def test_clips_and_windows_are_the_same_over_many_shards(tmp_path):
    items = listed(11)
    corpus = build_cache(items[::-1], tmp_path / "new" / "corpus", shard_clips=4)
    assert sorted(p.name for p in corpus.store.shards[0].path.parent.iterdir()) == [
        "corpus.json",
        *(f"shard-0000{n}.{kind}" for n in range(3) for kind in ("f32", "json")),
    ]
    same(corpus, items)
    again = Corpus.open(tmp_path / "new" / "corpus")
    same(again, items)
    again.check()
    assert repr(again) == "Corpus('folder', 11 clips, 1 contents, 3 styles)"
    for window in again.windows(3):
        whole = items[window.clip.index].source.read().motion
        assert torch.equal(window.motion.rotations, whole.rotations[window.start : window.start + 3])
    train = again.split("performer", (0.5, 0.0, 0.5)).train
    batch = next(iter(mk.datasets.batches(train.windows(5, short="pad"), 100)))
    assert len(train.performers) == 1 and len(batch.names) == len(train.windows(5, short="pad"))


def test_no_more_shards_are_open_than_a_process_may(tmp_path, monkeypatch):
    corpus = build_cache(listed(7), tmp_path, shard_clips=1)
    monkeypatch.setattr(stores, "_OPEN_SHARDS", 2)
    same(corpus, listed(7))
    assert corpus.store._maps.cache_info().currsize == 2


def test_any_folder_of_bvh(tmp_path):
    for name in ("odd name.bvh", "deep/down/walk-12.bvh", "deep/odd name.bvh"):
        (tmp_path / "clips" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "clips" / name).write_text(CHAIN)
    corpus = build_cache(tmp_path / "clips", tmp_path / "corpus")
    motion = mk.load(tmp_path / "clips" / "odd name.bvh")
    assert len(corpus) == 3 and torch.equal(corpus[2].motion.rotations, motion.rotations)
    labelled = build_cache(tmp_path / "clips" / "deep" / "down", tmp_path / "second", pattern="{content}-{take}")
    assert labelled.contents == ("walk",)


def test_stopped_and_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr(stores, "_BATCH", 1)
    log, items = tmp_path / "log", listed(10)
    logged = [replace(i, source=replace(i.source, log=str(log))) for i in items]
    stopped = [*logged[:6], replace(logged[6], source=replace(logged[6].source, fails=KeyboardInterrupt)), *logged[7:]]
    with pytest.raises(KeyboardInterrupt):
        build_cache(stopped, tmp_path / "corpus", shard_clips=2)
    assert len(dated(tmp_path / "corpus")) == 6 and not list((tmp_path / "corpus").glob(".*"))
    with pytest.raises(mk.MotionKitError, match=r"corpus: 2 of 5 shards are not made yet; run .*build_cache"):
        Corpus.open(tmp_path / "corpus")
    log.write_text("")
    before = dated(tmp_path / "corpus")
    same(build_cache(logged, tmp_path / "corpus", shard_clips=2), items)
    assert sorted(set(log.read_text().split())) == ["6", "7", "8", "9"]
    assert before.items() <= dated(tmp_path / "corpus").items()


SLOW = """
import signal, sys, time
sys.path.insert(0, {tests!r})
signal.signal(signal.SIGINT, signal.default_int_handler)  # shells start what is in the background without one
from dataclasses import dataclass
from made_clips import Made
from motionkit.datasets import Item, Labels, build_cache

@dataclass(frozen=True)
class Slow(Made):
    def read(self):
        time.sleep(0.02)
        return super().read()

if __name__ == "__main__":
    items = [Item(f"clip_{{n:03d}}", Labels("walk", "old", ()), Slow(n, frames=3)) for n in range(400)]
    build_cache(items, {out!r}, shard_clips=20)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="sends signals")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_process_that_is_stopped_leaves_whole_shards(tmp_path, how):
    script, out = tmp_path / "slow.py", tmp_path / "corpus"
    script.write_text(SLOW.format(tests=str(Path(__file__).parent), out=str(out)))
    process = subprocess.Popen([sys.executable, str(script)], stderr=subprocess.PIPE, start_new_session=True)
    try:
        while len(list(out.glob("shard-*.json"))) < 2 and process.poll() is None:
            time.sleep(0.02)
        os.killpg(process.pid, how)
        message = process.communicate(timeout=60)[1].decode()
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode != 0 and (how == signal.SIGKILL or "KeyboardInterrupt" in message)
    whole = dated(out)
    assert 4 <= len(whole) < 40
    if how == signal.SIGINT:
        assert not list(out.glob(".*"))
    for path in out.glob(".*"):
        os.utime(path, (0, 0))
    items = [Item(f"clip_{n:03d}", Labels("walk", "old", ()), Made(n, frames=3)) for n in range(400)]
    same(build_cache(items, out, shard_clips=20), items)
    kept = {name for name in whole if Path(name).with_suffix(".json").name in whole}
    assert {name: whole[name] for name in kept}.items() <= dated(out).items() and not list(out.glob(".*"))


@pytest.mark.parametrize(
    "name, damage, message",
    [
        ("shard-00001.f32", lambda b: b[:-4], "shard-00001.f32: the shard or its index is damaged .*the data have"),
        ("shard-00001.f32", None, "corpus: 1 of 3 shards are not made yet"),
        ("shard-00001.json", lambda b: b[: len(b) // 2], "shard-00001.f32: the shard or its index is damaged"),
        ("shard-00001.json", lambda b: b.replace(b'"format": 2', b'"format": 1'), "checksum or its format"),
        ("shard-00001.json", lambda b: b.replace(b"0.1", b"0.2", 1), "checksum or its format"),
        ("shard-00001.json", lambda b: b"[]", "shard-00001.f32: the shard or its index is damaged"),
        ("shard-00001.json", None, "shard-00001.f32: not a whole shard: shard-00001.json is missing"),
        ("corpus.json", lambda b: b"{}", "corpus.json: the corpus' plan is damaged"),
        ("corpus.json", lambda b: b[:9], "corpus.json: the corpus' plan is damaged"),
        ("corpus.json", None, r"no corpus here \(no corpus.json\)"),
    ],
)
def test_damage_is_named_and_only_that_is_made_again(tmp_path, name, damage, message):
    folder, items = tmp_path / "corpus", listed(6)
    build_cache(items, folder, shard_clips=2)
    before, path = dated(folder), folder / name
    data = None if damage is None else damage(path.read_bytes())
    path.unlink()
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(mk.MotionKitError, match=f"{message}.*build_cache"):
        Corpus.open(folder)
    same(build_cache(items, folder, shard_clips=2), items)
    after = dated(folder)
    changed = {n for n in after if after[n] != before[n]}
    assert changed == (set() if name == "corpus.json" else {"shard-00001.f32", "shard-00001.json"})


def test_a_flipped_bit_is_found(tmp_path):
    corpus = build_cache(listed(6), tmp_path, shard_clips=2)
    path = tmp_path / "shard-00002.f32"
    data = bytearray(path.read_bytes())
    data[-30] ^= 8
    path.write_bytes(data)
    with pytest.raises(mk.MotionKitError, match="shard-00002.f32: the cache is damaged at clip 'clip_005'; run .*"):
        corpus.check()
    same(build_cache(listed(6), tmp_path, shard_clips=2), listed(6))


def test_data_cut_off_after_opening(tmp_path):
    corpus = build_cache(listed(6), tmp_path, shard_clips=3)
    path = tmp_path / "shard-00001.f32"
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(
        mk.MotionKitError, match="shard-00001.f32: the data end before clip 'clip_005' does; run .*build"
    ):
        _ = corpus.windows(8)[-1].motion
    (tmp_path / "shard-00000.f32").unlink()
    with pytest.raises(mk.MotionKitError, match="shard-00000.f32: the data cannot be opened"):
        _ = corpus[0].motion


def test_changed_clips_and_shorter_lists(tmp_path):
    build_cache(listed(8), tmp_path, shard_clips=2)
    before = dated(tmp_path)
    items = listed(6)
    items[3] = replace(items[3], source=replace(items[3].source, version=2))
    same(build_cache(items, tmp_path, shard_clips=2), items)
    after = dated(tmp_path)
    assert len(after) == 6 and {n for n in after if after[n] != before[n]} == {"shard-00001.f32", "shard-00001.json"}
    relabelled = [replace(item, labels=item.labels._replace(style="new")) for item in items]
    assert build_cache(relabelled, tmp_path, shard_clips=2).styles == ("new",)
    assert {n for n in after if after[n] != dated(tmp_path)[n]} == {f"shard-0000{n}.json" for n in range(3)}


def test_a_bad_clip_stops_or_is_left_out(tmp_path):
    items = listed(5)
    items[2] = replace(items[2], source=replace(items[2].source, fails=mk.MotionKitError))
    with pytest.raises(mk.MotionKitError, match="clip 2.bvh, line 7"):
        build_cache(items, tmp_path, shard_clips=2)
    with pytest.warns(mk.MotionKitWarning, match="left out 'clip_002': clip 2.bvh, line 7"):
        corpus = build_cache(items, tmp_path, shard_clips=2, bad="skip")
    same(corpus, items[:2] + items[3:])
    same(build_cache(items, tmp_path, shard_clips=2), items[:2] + items[3:])


def test_what_makes_no_corpus(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(mk.MotionKitError, match="empty: no clips of folder here"):
        build_cache(tmp_path / "empty", tmp_path / "corpus")
    with pytest.raises(mk.MotionKitError, match="dataset 'folder' has no clips"):
        build_cache([], tmp_path / "corpus")
    with pytest.raises(mk.MotionKitError, match="two clips are called 'clip_000'"):
        build_cache(listed(1) * 2, tmp_path / "corpus")
    with pytest.raises(mk.MotionKitError, match="bad is 'stop' or 'skip', shard_clips a number from 1; found 'go'"):
        build_cache(listed(1), tmp_path / "corpus", bad="go")
    (tmp_path / "file").write_text("")
    with pytest.raises(mk.MotionKitError, match="file: cannot make the cache folder: .*choose another folder"):
        build_cache(listed(1), tmp_path / "file")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="everything is writable for root")
def test_a_folder_that_may_not_be_written(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(mk.MotionKitError, match="cache folder cannot be written; choose another folder"):
        build_cache(listed(1), tmp_path)
    tmp_path.chmod(0o700)


class HandsOverTogether(ThreadingBackend):
    """As Dask's backend: it cannot hand over results one by one."""

    supports_return_generator = False


@pytest.mark.parametrize("backend", ["threading", "together"])
def test_joblibs_settings_say_who_reads(tmp_path, monkeypatch, backend):
    joblib.register_parallel_backend("together", HandsOverTogether)
    monkeypatch.setattr(stores, "_FEW", 0)
    monkeypatch.setattr(stores, "_BATCH", 1)
    items = listed(40)
    threads = torch.get_num_threads()
    with joblib.parallel_config(backend):
        same(build_cache(items, tmp_path, shard_clips=7), items)
    assert torch.get_num_threads() == threads


def test_large_files_go_out_in_small_batches():
    sources = [BvhSource(File("", "", None, size, 0)) for size in SIZES]
    items = [Item(f"{n}", Labels("", "", ()), source) for n, source in enumerate(sources)]
    batches = stores._batches(items)
    assert [[int(name) for name, _ in batch] for batch in batches] == [[0], [1], [2, 3, 4], [5]]


SIZES = [1 << 27, 1 << 24, 100, 200, 300, 1 << 24]


def test_reading_keeps_memory_flat(tmp_path):
    if math.isnan(private_mb()):
        pytest.skip("this system does not say how much memory is private")
    code = """if True:  # in a process of its own: here, memory might come from what earlier tests have freed
        import json, pathlib, sys
        import numpy as np
        from motionkit.benchmarks.corpus import corpus_speed, private_mb
        before = private_mb()
        held = np.ones(5_000_000)  # 40 MB
        seen = private_mb() - before
        print(json.dumps({"seen": seen, **corpus_speed(pathlib.Path(sys.argv[1]), frames=20_000, batches=60)}))
    """
    run = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True)
    found = json.loads(run.stdout.splitlines()[-1])
    assert 35 < found["seen"] < 50
    assert found["frames"] == 20_000 and found["memory_growth_mb"] < 10 and found["batches_per_s"] > 10
    assert json.loads((tmp_path / "corpus.json").read_text())["name"] == "folder"
