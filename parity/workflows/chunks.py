"""What the workflow knows of a sweep: its commands, and how many chunks it has.

The number of chunks comes from a trial: some jobs of the plan are done first, and their records say what
they took.
"""

import json
import math
import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

# A count beyond any plan: its first shard has the first job alone, and its message says how long the plan is.
ALL_BUT_ONE = 2**32 - 1
COUNTED = re.compile(r"^(\d+) of (\d+) records are there", re.MULTILINE)


def fail(place, found, expected, remedy):
    """Ends the workflow with an error that says what to do."""
    sys.exit(f"error: {place}: found {found}; expected {expected}. {remedy}")


@dataclass
class Sweep:
    """The settings of a sweep, as its file names them."""

    # The study, tuning or suite.
    file: str
    # Where everything goes: on a cluster a folder that all nodes see.
    output: str
    # A command of the program with --shard and --merge, such as study, tune or parity.
    command: str = "study"
    # The program; on a cluster with a container, all words that run it there.
    program: str = "target/release/cloudparity"
    # Further options of the command.
    options: list = field(default_factory=list)
    # Whether the command has a step that makes what many jobs need (--prepare), and by how many machines.
    prepare: int | None = None
    # Minutes that a chunk takes at least. Below half an hour, starting and merging cost more than they bring.
    chunk_minutes: float = 30.0
    # Jobs that are timed to find out how many make a chunk.
    trial_jobs: int = 8
    # Processors of a chunk; all of the machine where none are named.
    threads: int | None = None

    @classmethod
    def of(cls, config):
        """Reads the settings, and refuses what is none."""
        known = cls.__dataclass_fields__
        place = "the file of the sweep (--configfile)"
        for name in config:
            if name not in known:
                fail(place, f'"{name}"', f"one of {', '.join(known)}", "Correct the name.")
        for name in ("file", "output"):
            if not config.get(name):
                fail(place, f"no {name}", "its path", "Add it; parity/workflows/sweep.yaml is an example.")
        sweep = cls(**config)
        if sweep.prepare is None:
            sweep.prepare = 1 if sweep.command == "study" else 0
        numbers = {
            "prepare": (sweep.prepare, 0, int),
            "trial_jobs": (sweep.trial_jobs, 1, int),
            "threads": (sweep.threads or 1, 1, int),
            "chunk_minutes": (sweep.chunk_minutes, 0.01, (int, float)),
        }
        for name, (value, least, kind) in numbers.items():
            if isinstance(value, bool) or not isinstance(value, kind) or value < least:
                fail(f"{place}, {name}", repr(value), f"a number of at least {least}", "Correct it.")
        if not isinstance(sweep.options, list) or not all(isinstance(one, str) for one in sweep.options):
            words = 'a list of words, such as ["--mix-builds"]'
            fail(f"{place}, options", repr(sweep.options), words, "Correct it.")
        if not Path(sweep.file).is_file():
            found = f"{sweep.file}, which is no file"
            fail(f"{place}, file", found, "a study, tuning or suite", "Correct the path.")
        return sweep

    def words(self, folder, *more):
        """The command that works in a folder below the output, as words."""
        program = shlex.split(self.program)
        return [*program, self.command, self.file, "-o", f"{self.output}/{folder}", *self.options, *more]

    def shard(self, number, count):
        """The option of a shard; all of a plan needs none."""
        return [] if int(count) == 1 else ["--shard", f"{number}/{count}"]

    def prepared(self):
        """The folders with what was made beforehand."""
        return [f"{self.output}/prepared/{number}-of-{self.prepare}" for number in range(1, self.prepare + 1)]

    def prepared_marks(self):
        """The files that say that they are whole."""
        return [f"{folder}.done" for folder in self.prepared()]

    def preparation(self, number, count):
        """Makes a part of what many jobs need."""
        part = self.shard(number, count)
        return shlex.join(self.words(f"prepared/{number}-of-{count}", "--prepare", *part))

    def merged(self, folders):
        """The option that takes records over."""
        return ["--merge", *folders] if folders else []

    def chunk(self, number, count):
        """Does a chunk, beginning with what was prepared and tried."""
        begun = self.merged([*self.prepared(), f"{self.output}/trial"])
        return shlex.join(self.words(f"chunks/{number}-of-{count}", *self.shard(number, count), *begun))

    def merge(self):
        """Brings all records together. The shell lists the chunks: thousands of names are too long for it."""
        begun = self.merged([*self.prepared(), f"{self.output}/trial"])
        words = shlex.join(self.words("results", "--only-merge", *begun))
        return f"{words} {shlex.quote(self.output)}/chunks/*-of-*/"


def read(path):
    """A JSON file."""
    return json.loads(Path(path).read_text(encoding="utf-8"))


def run(words):
    """Runs the program, shows what it says on stderr, and returns it; ends the workflow where it fails."""
    done = subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    sys.stderr.write(done.stderr)
    if done.returncode != 0:
        sys.exit(f"error: {shlex.join(words)} ended with status {done.returncode}; the line above says why")
    return done.stderr


def records(folder):
    """The records below a folder, as paths relative to it."""
    return {path.relative_to(folder) for path in Path(folder).glob("*/" + "[0-9a-f]" * 16 + ".json")}


def trial(sweep, path):
    """Does some jobs of the plan, and writes how many chunks it needs."""
    folder = Path(sweep.output) / "trial"
    begun = sweep.merged(sweep.prepared())
    counted = COUNTED.search(run(sweep.words("trial", "--shard", f"1/{ALL_BUT_ONE}", *begun)))
    jobs, there = (int(counted[2]), int(counted[1])) if counted else (0, 0)
    seconds = []
    if there < jobs:
        parts = max(1, (jobs - there) // sweep.trial_jobs)
        # The middle one: the first job of a plan is often unlike the others.
        run(sweep.words("trial", *sweep.shard((parts + 1) // 2, parts), *begun))
        known = set().union(*(records(prepared) for prepared in sweep.prepared()))
        spent = [read(folder / name).get("spent") for name in sorted(records(folder) - known)]
        seconds = [one["wall_seconds"] for one in spent if one]
    left = max(0, jobs - there - len(seconds))
    mean = sum(seconds) / len(seconds) if seconds else 0.0
    count = max(1, min(left, math.floor(left * mean / (60 * sweep.chunk_minutes))))
    found = {
        "jobs": jobs,
        "there_before": there,
        "timed": len(seconds),
        "seconds_per_job": mean,
        "seconds_left": left * mean,
        "chunks": count,
    }
    temporary = Path(f"{path}.{os.getpid()}")
    temporary.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    temporary.replace(path)
