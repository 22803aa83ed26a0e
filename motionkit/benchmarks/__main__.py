"""Measure a benchmark, all of it or some figures: `python -m motionkit.benchmarks few_shot [--only FIGURE ...]`."""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import torch

from ..checkpoints import hardware
from ..errors import MotionKitError
from ..files import write_atomic
from . import ROOT, Entry, entries

NAMES = ("io", "actor", "arena", "diffusion", "few_shot", "style_erd")
SEED = 0
ABOUT_RUN = ("command", "commit", "hardware", "seed", "seconds")


def run(
    name: str, listed: Sequence[Entry], root: Path = ROOT, only: Sequence[str] = (), *, dirty: bool = False
) -> Path:
    """Measure a benchmark and write `results/NAME.json` in `root`, whole or not at all; returns its path.

    only: names of the figures and tables to measure; those that the file has beside them stay, and `other_runs` says
    what was measured when. Raises MotionKitError for a name that is none, and for a tree with changes that are not
    committed, unless `dirty`.
    """
    known = [entry.name for entry in listed]
    unknown = [word for word in only if word not in known]
    if unknown:
        raise MotionKitError(f"{name} does not measure {', '.join(unknown)}; it measures {', '.join(known)}")
    commit, start = commit_of(root, dirty=dirty), time.perf_counter()
    measured = measure([entry for entry in listed if not only or entry.name in only])
    command = f"make bench NAME={name}" + (f' ONLY="{" ".join(only)}"' if only else "")
    facts = (command, commit, hardware(), SEED, round(time.perf_counter() - start, 1))
    result = dict(zip(ABOUT_RUN, facts)) | measured
    path = root / "results" / f"{name.replace('_', '-')}.json"
    path.parent.mkdir(exist_ok=True)
    if only and path.exists():
        result = with_replaced(json.loads(path.read_text()), result)
    return write_atomic(path, json.dumps(result, indent=2) + "\n")


def measure(listed: Sequence[Entry]) -> dict[str, dict]:
    """Figures and tables, each function called once, from the same seed; figures are printed as they come."""
    outcomes: dict = {}
    measured: dict[str, dict] = {"figures": {}, "tables": {}}
    for entry in listed:
        if entry.measure not in outcomes:
            torch.manual_seed(SEED)
            outcomes[entry.measure] = entry.measure()
        content = entry.to_json(outcomes[entry.measure])
        if content is None:
            print(f"       {entry.name:26s} cannot be measured here", flush=True)
            continue
        measured[entry.kind][entry.name] = content
        print(line_of(entry.name, content), flush=True)
    return measured


def line_of(name: str, content: dict | list) -> str:
    """A figure or a table in a line, as it is printed."""
    if isinstance(content, list):
        return f"table  {name:26s} {len(content)} rows"
    sign = "met   " if content["met"] else "MISSED"
    target = f"target {content['target']:,}"
    return f"{sign} {name:26s} {content['value']:>12,g} {content['unit']} ({target}; {content['note']})"


def with_replaced(before: dict, now: dict) -> dict:
    """The results of an earlier run with what was measured now; `other_runs` says which entries are not that run's."""
    names = [*now["figures"], *now["tables"]]
    others = []
    for other in before.get("other_runs", []):
        rest = [name for name in other["entries"] if name not in names]
        others += [other | {"entries": rest}] if rest else []
    others.append({key: now[key] for key in ABOUT_RUN} | {"entries": names})
    parts = {kind: before.get(kind, {}) | now[kind] for kind in ("figures", "tables")}
    return {key: before[key] for key in ABOUT_RUN} | {"other_runs": others} | parts


def commit_of(root: Path, *, dirty: bool = False) -> str:
    """The commit that is measured, with "-dirty" where the tree is not as committed; MotionKitError unless `dirty`.

    Results do not count, so that several benchmarks can be run before they are committed.
    """
    status = _git(root, "status", "--porcelain", "--", ".", ":(exclude)results")
    commit = (_git(root, "rev-parse", "--short=7", "HEAD") or "unknown").strip()
    if status == "":
        return commit
    if not dirty:
        what = "this is no git checkout" if status is None else f"changed: {', '.join(status.split()[1::2][:5])}"
        raise MotionKitError(f"{root}: results must say which code they measured, and {what}; commit, or give --dirty")
    return f"{commit}-dirty"


def _git(root: Path, *arguments: str) -> str | None:
    """What git answers; None where it fails."""
    try:
        answer = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return answer.stdout


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the benchmark that the command line names."""
    parser = argparse.ArgumentParser("python -m motionkit.benchmarks", description="Measure into results/NAME.json.")
    parser.add_argument("name", choices=NAMES)
    parser.add_argument("--only", nargs="+", default=[], metavar="FIGURE", help="figures and tables to measure anew")
    parser.add_argument("--dirty", action="store_true", help="measure a tree with changes; the results say so")
    args = parser.parse_args(arguments)
    try:
        listed = entries(importlib.import_module(f"{__package__}.{args.name}").__name__)
        print(run(args.name, listed, only=args.only, dirty=args.dirty))
    except MotionKitError as error:
        print(f"motionkit: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
