#!/usr/bin/env python3
"""Whether a sweep has every record once, and the same results as one process: `make sweep-test` calls it.

    tools/sweep_check.py ALONE SWEEP

ALONE is the folder of a study by one process, SWEEP the output of the workflow. Times differ, and so do
Pareto fronts, which are made of times and errors. What is compared is therefore the errors of every run,
exactly, and the fronts that both have with the same times.
"""

import json
import sys
from pathlib import Path

KEY = "[0-9a-f]" * 16 + ".json"


def fail(place, found, expected):
    sys.exit(f"error: {place}: found {found}; expected {expected}. The records are there to be looked at.")


def read(path):
    return json.loads(Path(path).read_text(encoding="utf-8"))


def front(runs, seconds):
    """The runs of each scene and density that no other beats in error and time."""
    kept = set()
    groups = {}
    for run in runs:
        key = (run["combination"]["scene"], run["combination"]["density"])
        groups.setdefault(key, []).append((seconds[run["id"]], run["errors"]["relmse"]["value"], run["id"]))
    for group in groups.values():
        least = float("inf")
        for _, error, name in sorted(group):
            if error < least:
                least = error
                kept.add(name)
    return kept


def once(sweep):
    """Every record of a run was made once: links to one file count as one."""
    makers = {}
    for folder in [sweep / "trial", *sorted((sweep / "chunks").glob("*-of-*/"))]:
        for path in (folder / "runs").glob(KEY):
            makers.setdefault(path.name, set()).add(path.stat().st_ino)
    for name, files in makers.items():
        if len(files) != 1:
            fail(name, f"{len(files)} records of one run", "one")
    merged = {path.name for path in (sweep / "results" / "runs").glob(KEY)}
    if merged != set(makers):
        apart = len(merged ^ set(makers))
        fail(sweep, f"{apart} records in the chunks or the results alone", "the same in both")
    return merged


def main(alone, sweep):
    ours, theirs = read(alone / "results.json"), read(sweep / "results" / "results.json")
    records = once(sweep)
    wanted = {path.name for path in (alone / "runs").glob(KEY)}
    if records != wanted:
        unlike = len(records ^ wanted)
        fail(sweep, f"{len(records)} records, {unlike} of them unlike", f"the {len(wanted)} of {alone}")
    # HDR-FLIP is added when a study is summed up, by packages that may be missing: of both, or not compared.
    apart = {"seconds", "wall_seconds", "prepare_seconds", "cost", "flip"}
    content = {run["id"]: run for run in ours["runs"]}
    flips = 0
    for run in theirs["runs"]:
        known = content[run["id"]]
        both = [{name: value for name, value in one.items() if name not in apart} for one in (known, run)]
        if both[0] != both[1]:
            fail(f"run {run['id']}", "other errors than by one process", "the same bits")
        if known["flip"] is not None and run["flip"] is not None:
            flips += 1
            if known["flip"] != run["flip"]:
                fail(f"run {run['id']}", f"HDR-FLIP {run['flip']}", f"that by one process, {known['flip']}")
    by_ours = {run["id"]: run["seconds"]["median"] for run in ours["runs"]}
    by_theirs = {run["id"]: run["seconds"]["median"] for run in theirs["runs"]}
    for results, seconds, name in [(ours, by_ours, alone), (theirs, by_theirs, sweep)]:
        if set(results["front"]) != front(ours["runs"], seconds):
            size = len(results["front"])
            fail(name, f"a front of {size} runs", "that of one process's errors with these times")
    if front(theirs["runs"], by_ours) != set(ours["front"]):
        fail(sweep, "another front with the times of one process", "the same")
    common = len(set(ours["front"]) & set(theirs["front"]))
    print(
        f"{len(records)} records, each once, with the errors of one process to the last bit; with the same "
        f"times the same fronts ({len(ours['front'])} runs). By times of their own the fronts have "
        f"{len(ours['front'])} and {len(theirs['front'])} runs, {common} in common. "
        f"HDR-FLIP was compared for {flips} runs."
    )


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(
            "error: the arguments: found something else; expected ALONE SWEEP. See the top of this file."
        )
    main(Path(sys.argv[1]), Path(sys.argv[2]))
