"""The arena: what it runs, that it goes on where it was, that failures show, and that one seed is one table."""

import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import arena_lab as lab
import joblib
import pytest
import torch
from joblib.parallel import ThreadingBackend

import motionkit as mk
from motionkit.arena import Protocol, transfers
from motionkit.arena.cache_key import cache_key
from motionkit.arena.transfers import one_thread
from motionkit.datasets import Split

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent
QUICK = Protocol("quick", columns=("fmd", "cra", "sra", "truth_error", "tsi", "fsf", "fca", "jitter"))
FEW = Protocol("few", most=8, columns=("cra", "sra"))


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    """A small split and its judge, with a cache of their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        split = lab.small_split()
        with one_thread():
            yield split, lab.Judge(split.test)


def arena(clips, folder, methods, protocol=QUICK, **options):
    split, judge = clips
    return mk.arena.run(methods, split, protocol, **{"judge": judge, "folder": folder, "jobs": 1, **options})


@pytest.fixture(scope="module")
def table(clips, tmp_path_factory):
    methods = {"content": lab.copy_content, "style": lab.copy_style, "noisy": lab.noisy, "moody": lab.moody}
    return arena(clips, tmp_path_factory.mktemp("arena"), methods)


def value(table, method, column):
    return table[method].cell(column).value


def test_copies_bound_the_table_from_both_ends(table):
    assert (value(table, "content", "cra"), value(table, "content", "sra")) == (100, 0)
    assert (value(table, "style", "cra"), value(table, "style", "sra")) == (0, 100)
    assert value(table, "content", "tsi") == 0 and value(table, "content", "fca") == 100
    assert value(table, "content", "jitter") == 1 and value(table, "style", "tsi") > 0.1
    assert (value(table, "real", "cra"), value(table, "real", "sra")) == (100, 100)
    assert value(table, "noisy", "jitter") > 10 and value(table, "noisy", "fsf") > 5


def test_every_row_names_its_dataset(table):
    assert {row.dataset for row in table.rows} == {record["dataset"] for record in table.records()} == {"actor"}


def test_intervals_hold_their_values(table):
    for row in table.rows:
        for column in table.columns:
            cell = row.cell(column)
            if cell.low == cell.low:
                assert cell.low <= cell.value <= cell.high, (row.method, column)
    assert table["noisy"].cell("tsi").low < table["noisy"].cell("tsi").high


def test_the_exact_answer_has_no_error(clips, tmp_path):
    from motionkit.actor import retell
    from motionkit.datasets import performed

    sources = {item.name: item.source for item in performed.items("actor")}

    class Cheat(mk.methods.StyleTransfer):
        name = "truth"

        def stylize(self, content, style, *_, **__):
            told = sources[content.name].perform()
            return retell(told, style.style).time_aligned(told)

    found = arena(
        clips, tmp_path, {"truth": Cheat(), "copy": lab.copy_content}, Protocol("t", most=6, columns=("truth_error",))
    )
    assert value(found, "truth", "truth_error") < 0.01 and value(found, "copy", "truth_error") > 50
    assert found.best("truth_error") == "truth"


def test_failures_are_counted_and_shown(table):
    row = table["moody"]
    outcomes = list(table.results("moody"))
    good = [o for o in outcomes if not o.problem]
    assert len(row.failed) == sum(bool(o.problem) for o in outcomes) == 36 - len(good) and len(good) == 4
    problems = set(row.failed.values())
    for part in ("ValueError: no old people please", "a str instead", "no frames", "not finite", "another skeleton"):
        assert any(part in problem for problem in problems), part
    assert row.cell("cra").value == pytest.approx(100 * 4 / 36)  # wrong, not missing
    assert row.cell("tsi").missing == 32 and row.cell("tsi").value == 0
    assert math.isnan(row.cell("fmd").value) and "at least 9" in row.cell("fmd").why
    text = str(table)
    assert (
        "32 of 36 transfers failed" in text
        and text.count("_14 as ") == 3
        and "without 32 of 36" in text
        and "0.000*" in text
    )
    with pytest.raises(mk.MotionKitError, match="no result"):
        _ = next(o for o in outcomes if o.problem).motion
    assert torch.isnan(table.results("moody").scores("content")).any(1).sum() == 32


def test_shrinkage_is_said_by_name(clips, tmp_path):
    found = arena(clips, tmp_path, {"moody": lab.moody}, Protocol("f", columns=("fmd",)), shrinkage=0.1)
    assert value(found, "moody", "fmd") > 0 and "shrinkage 0.1" in str(found)


def test_other_lengths_have_no_frame_by_frame_figures(table):
    for column in ("truth_error", "fca"):
        assert table["style"].cell(column).missing == 36 and math.isnan(value(table, "style", column))
    assert "* style: ground-truth error mm, FCA % without 36 of 36" in str(table)


def test_one_seed_is_one_table_however_many_jobs(clips, tmp_path, table):
    methods = {"noisy": lab.noisy}
    one, two = (arena(clips, tmp_path / str(jobs), methods, jobs=jobs).records() for jobs in (1, 2))
    assert one == two
    assert one[0] == next(r for r in table.records() if r["method"] == "noisy")
    other = arena(clips, tmp_path, {"noisy": lab.noisy}, FEW, seed=1)
    drawn = {(t.content, t.style) for t in arena(clips, tmp_path, {"noisy": lab.noisy}, FEW).results("noisy").transfers}
    assert {(t.content, t.style) for t in other.results("noisy").transfers} != drawn


def test_functions_of_a_notebook_go_to_other_processes(clips, tmp_path):
    share = 0.5

    def lowered(content, style):
        return content.transform(offset=(0.0, -share, 0.0))

    found = arena(clips, tmp_path, [lowered], jobs=2)
    assert found.results("lowered")[0].motion.positions()[..., 1].mean() < 0.6 and not found["lowered"].failed


class HandsOverTogether(ThreadingBackend):
    """A backend of joblib's that cannot give results one by one."""

    supports_retrieve_callback = False
    supports_return_generator = False


def add(shared, task):
    return shared + sum(task)


def test_tasks_fan_out_by_joblib_and_come_back_in_order():
    tasks = [[n] * 20 for n in range(5)]
    joblib.register_parallel_backend("together", HandsOverTogether)
    for backend in ("loky", "threading", "together"):
        with joblib.parallel_config(backend):
            assert list(transfers.parallel(add, 1000, tasks, 2, "adding", "number")) == [
                1000 + 20 * n for n in range(5)
            ]
    with pytest.raises(mk.MotionKitError, match="cannot be sent to other processes .* with jobs=1"):
        list(transfers.parallel(add, threading.Lock(), tasks, 2, "adding", "number"))
    with pytest.raises(mk.MotionKitError, match="a worker process died"):
        list(transfers.parallel(lambda shared, task: os.kill(os.getpid(), 9), 0, tasks, 2, "dying", "worker"))


def test_an_interrupted_run_goes_on(clips, tmp_path):
    log, stop = tmp_path / "log", tmp_path / "log.stop"
    stop.write_text("3")
    with pytest.raises(KeyboardInterrupt):
        arena(clips, tmp_path, lab.Counting(log), FEW)
    stop.unlink()
    assert len(list(tmp_path.rglob("*/0*.safetensors"))) == 3
    first = arena(clips, tmp_path, lab.Counting(log), FEW).records()
    assert len(lab.Counting(log).calls()) == len(set(lab.Counting(log).calls())) == 8
    again = arena(clips, tmp_path, lab.Counting(log), FEW).records()
    assert again == first and len(lab.Counting(log).calls()) == 8
    arena(clips, tmp_path, lab.Counting(log), FEW, resume=False)
    assert len(lab.Counting(log).calls()) == 16


def test_damaged_results_are_made_again(clips, tmp_path):
    log = tmp_path / "log"
    first = arena(clips, tmp_path, lab.Counting(log), FEW).records()
    paths = sorted(p for p in tmp_path.rglob("counting-*/0*.safetensors"))
    assert len(paths) == 8
    data = paths[2].read_bytes()
    paths[2].write_bytes(data[: len(data) // 2])
    paths[4].write_bytes(data[:-2] + bytes([data[-2] ^ 1]) + data[-1:])
    paths[5].write_bytes(b"")
    assert arena(clips, tmp_path, lab.Counting(log), FEW).records() == first
    assert len(lab.Counting(log).calls()) == 11


def test_failed_transfers_are_tried_again(clips, tmp_path):
    switch = tmp_path / "works"

    def moody(content, style):
        if not Path(path).exists() and "old" in style.name:
            raise RuntimeError("not today")
        return content

    path = str(switch)
    first = arena(clips, tmp_path, [moody], FEW)
    assert first["moody"].failed
    switch.touch()
    again = arena(clips, tmp_path, [moody], FEW)
    assert not again["moody"].failed and value(again, "moody", "cra") == 100 > value(first, "moody", "cra")


KILLED = """
import sys, arena_lab as lab, motionkit as mk
split = lab.small_split()
folder = sys.argv[1]
if __name__ == "__main__":
    method = lab.Counting(folder + "/log", slow=0.02)
    mk.arena.run(method, split, "paper-1", judge=lab.Judge(split.test), folder=folder, jobs=1)
"""


def test_a_killed_run_goes_on(clips, tmp_path):
    counting, script = lab.Counting(tmp_path / "log", slow=0.02), tmp_path / "script.py"
    script.write_text(KILLED)
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    command = [sys.executable, str(script), str(tmp_path)]
    process = subprocess.Popen(command, env=paths, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 60
    while len(counting.calls()) < 6 and process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    process.kill()
    process.wait()
    before = len(counting.calls())
    assert 6 <= before < 36
    found = arena(clips, tmp_path, counting, "paper-1")
    assert not found["counting"].failed and len(found.results("counting")) == 36
    assert 36 <= len(counting.calls()) <= 37  # what was under way is done again, nothing else


def test_chance_and_inputs_stay_what_they_were(clips, tmp_path):
    def spoils(content, style):
        content.rotations.zero_()
        style.translations.zero_()
        return content

    torch.manual_seed(3)
    wanted = torch.rand(3)
    torch.manual_seed(3)
    found = arena(clips, tmp_path, {"spoils": spoils, "noisy": lab.noisy}, FEW)
    assert torch.equal(torch.rand(3), wanted)
    assert "unit quaternions" in next(iter(found["spoils"].failed.values())) and not found["noisy"].failed
    assert value(found, "noisy", "cra") == 100


def test_methods_learn_from_the_training_clips(clips, tmp_path):
    class Learner:
        def __init__(self):
            self.seen = ()

        def fit(self, train):
            self.seen = tuple(clip.name for clip in train)

        def stylize(self, content, style):
            assert self.seen == wanted
            return content

    wanted, learner = tuple(clip.name for clip in clips[0].train), Learner()
    assert not arena(clips, tmp_path, {"learner": learner}, FEW)["learner"].failed
    assert learner.seen == ()  # a copy learned

    class Broken(Learner):
        def fit(self, train):
            raise OSError("no weights")

    failed = arena(clips, tmp_path, {"broken": Broken()}, FEW)["broken"].failed
    assert len(failed) == 8 and failed[0].endswith(": fit: OSError: no weights")


def test_without_training_clips_there_is_still_a_row_of_real_ones(clips, tmp_path):
    split, judge = clips
    alone = Split(split.train[:0], split.train[:0], split.test)
    found = mk.arena.run(lab.copy_content, alone, FEW, judge=judge, folder=tmp_path, jobs=1)
    assert value(found, "real", "cra") == 100 and math.isnan(value(found, "real", "fmd"))
    assert len(found.results("real")) == 9 and len(found.results("real")[2].motion) > 100


def test_what_does_not_fit_is_told(clips, tmp_path, monkeypatch):
    split, judge = clips

    def told(pattern, methods=lab.copy_content, **options):
        with pytest.raises(mk.MotionKitError, match=pattern):
            mk.arena.run(methods, **{"dataset": split, "judge": judge, "folder": tmp_path, "jobs": 1, **options})

    told("no protocol 'paper-9'", protocol="paper-9")
    told("no method", methods="statistic")
    told("make one: Counting()", methods=lab.Counting)
    told("is no method", methods={"mine": 3})
    told("appears twice", methods=[lab.noisy, lab.noisy])
    told("row of the test clips", methods={"real": lab.noisy})
    told("methods", methods=[])
    told("whole number", seed="a")
    told("jobs", jobs=0)
    told("finds no pair", dataset=Split(split.train, split.validation, split.test.filter(style="old")))
    told("data set by name", dataset=3)
    told("is read already", root=tmp_path)
    told("classifiers .content and .style", judge=3)
    other = lab.Judge(split.test.filter(style=("old", "proud")))
    told("style 'neutral', for which this judge was not trained", judge=other)
    strange = lab.Judge(split.test)
    strange.style.skeleton = mk.Skeleton(("a",), (-1,), torch.zeros(1, 3))
    told("other joints", judge=strange)


def test_keys_change_with_what_a_method_is():
    def make(share, bias=0.0):
        def method(content, style, scale=1.0):
            return content if share > bias else style

        return method

    assert cache_key(make(0.5)) == cache_key(make(0.5)) != cache_key(make(0.6))
    changed = make(0.5)
    changed.__defaults__ = (2.0,)
    assert cache_key(changed) != cache_key(make(0.5))
    scopes = [{}, {}, {}]
    codes = ("h = lambda x: x + 1", "h = lambda x: x + 2", "h = lambda x: x + 1")
    for scope, code in zip(scopes, codes):
        exec(f"{code}\nlimit = 3\ndef method(a, b): return h(a) + limit", scope)
    first, other, same = (cache_key(scope["method"]) for scope in scopes)
    assert first == same != other
    scopes[2]["limit"] = 4
    assert cache_key(scopes[2]["method"]) != first

    net, twin = torch.nn.Linear(2, 2), torch.nn.Linear(2, 2)
    twin.load_state_dict(net.state_dict())
    assert cache_key(net) == cache_key(twin)
    with torch.no_grad():
        twin.bias[0] += 1
    assert cache_key(net) != cache_key(twin)
    assert cache_key(mk.methods.load("statistics")) == cache_key(mk.methods.load("statistics"))
    assert cache_key({1: [2, {3, "a"}]}) != cache_key({1: [2, {3, "b"}]})
    with pytest.raises(mk.MotionKitError, match="dict: cannot tell .*cannot pickle .*; give its class a __get"):
        cache_key({"lock": threading.Lock()})


def test_the_kits_own_methods_count_by_name_version_and_state(monkeypatch):
    before = cache_key(mk.methods.load("statistics"))
    monkeypatch.setattr(mk.methods.baselines.Statistics, "stylize", lambda *_: None)
    assert cache_key(mk.methods.load("statistics")) == before != cache_key(mk.methods.load("linear"))
    monkeypatch.setattr(mk.methods.baselines.Statistics, "version", 99, raising=False)
    assert cache_key(mk.methods.load("statistics")) != before


def test_a_users_method_counts_by_its_code_and_state():
    def make(sign, share=0.5):
        class Mine:
            limit = sign

            def __init__(self):
                self.share, self.myself = share, self

            @property
            def both(self):
                return self.limit + 1 if sign > 0 else self.limit - 1

            def stylize(self, content, style):
                return super().__repr__() and content if self.both else style

        return Mine()

    assert cache_key(make(1)) == cache_key(make(1)) != cache_key(make(-1))
    assert cache_key(make(1)) != cache_key(make(1, 0.6)) and cache_key(make(1).stylize) == cache_key(make(1).stylize)


def test_keys_are_the_same_in_every_process():
    things = "(f(lab.moody), f(lab.Counting('x')), f(mk.methods.load('statistics')), f({'a', 'b', 'c'}))"
    code = "import arena_lab as lab, motionkit as mk\nfrom motionkit.arena.cache_key import cache_key as f\n"
    paths = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    environment = {**os.environ, "PYTHONPATH": paths, "PYTHONHASHSEED": "7"}
    command = [sys.executable, "-c", f"{code}print({things})"]
    there = subprocess.run(command, env=environment, capture_output=True, check=True)
    assert there.stdout.decode().strip() == str(eval(things, {"f": cache_key, "lab": lab, "mk": mk}))


def test_results_come_back_as_they_were(tmp_path):
    walk = mk.load(ROOT / "data" / "actor" / "walk_neutral.bvh")
    moved = walk.translations.clone()
    moved[5, 7] += 0.25
    for n, motion in enumerate((walk, walk[3:9], walk.replace(translations=moved))):
        transfers.save_result(tmp_path / str(n), motion, walk, {"seconds": 0.1})
        back, facts = transfers.load_result(tmp_path / str(n), walk)
        assert torch.equal(back.rotations, motion.rotations) and torch.equal(back.translations, motion.translations)
        assert facts["seconds"] == 0.1 and back.name == motion.name
    assert (tmp_path / "0").stat().st_size < 0.7 * walk.rotations.numel() * 7  # translations of the root alone


def test_the_clips_themselves_are_looked_at_once_for_all_protocols(clips, tmp_path):
    def looks() -> dict:
        found = sorted(path for path in tmp_path.rglob("clips-*") if path.is_file())
        return {path.name.split("-")[1]: (path, path.stat().st_mtime_ns) for path in found}

    one = arena(clips, tmp_path, "copy-content", FEW)
    before = looks()
    assert sorted(before) == ["test", "train"]
    two = arena(clips, tmp_path, "copy-content", Protocol("other", most=3))
    assert looks() == before
    assert one["real"].cell("sra") == two["real"].cell("sra")
