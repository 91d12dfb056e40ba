"""The workflow of sweeps: its settings, its commands, and how many chunks a trial leads to."""

import importlib.util
import json
import shlex
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location("chunks", ROOT / "parity/workflows/chunks.py")
chunks = importlib.util.module_from_spec(SPEC)
sys.modules["chunks"] = chunks
SPEC.loader.exec_module(chunks)

# Stands for the program: jobs of a plan as records of some seconds, those of a shard alone.
PROGRAM = """
import json, sys
from pathlib import Path
jobs, seconds = 1000, SECONDS
words = sys.argv[1:]
folder = Path(words[words.index("-o") + 1])
number, count = (map(int, words[words.index("--shard") + 1].split("/"))) if "--shard" in words else (1, 1)
(folder / "runs").mkdir(parents=True, exist_ok=True)
for position in range(number - 1, jobs, count):
    path = folder / "runs" / f"{position:016x}.json"
    path.write_text(json.dumps({"spent": {"wall_seconds": seconds}, "record": position}))
done = len(list((folder / "runs").glob("*.json")))
sys.stderr.write(f"a note\\n{done} of {jobs} records are there; the shard that makes the last one sums up\\n")
"""


def sweep(folder, seconds=1.0, **more):
    program = folder / "program.py"
    program.write_text(PROGRAM.replace("SECONDS", str(seconds)))
    study = folder / "a study.toml"
    study.write_text("")
    settings = {"file": str(study), "output": str(folder / "out"), "prepare": 0}
    return chunks.Sweep.of({**settings, "program": f"{sys.executable} {program}", **more})


@pytest.mark.parametrize(
    ("seconds", "wanted"),
    # 1000 jobs, of which the trial has done some eight: less than half an hour, some four, and a chunk for
    # each job where a job takes longer than a chunk.
    [(0.01, {1}), (7.5, {4}), (3600.0, set(range(985, 993)))],
)
def test_a_trial_says_how_many_chunks_of_half_an_hour_there_are(tmp_path, seconds, wanted):
    path = tmp_path / "chunks.json"
    chunks.trial(sweep(tmp_path, seconds), path)
    found = json.loads(path.read_text())
    assert found["jobs"] == 1000 and found["seconds_per_job"] == pytest.approx(seconds)
    assert 8 <= found["timed"] <= 12 and found["chunks"] in wanted, found
    assert [one.name for one in tmp_path.glob("chunks.json*")] == ["chunks.json"]


def test_commands_are_shards_that_begin_with_what_was_prepared_and_tried(tmp_path):
    made = sweep(tmp_path, prepare=2, options=["--mix-builds"])
    out = f"{tmp_path}/out"
    begun = ["--merge", f"{out}/prepared/1-of-2", f"{out}/prepared/2-of-2", f"{out}/trial"]
    words = shlex.split(made.chunk(3, 12))
    assert words[2:] == [
        *("study", f"{tmp_path}/a study.toml", "-o", f"{out}/chunks/3-of-12", "--mix-builds"),
        *("--shard", "3/12", *begun),
    ]
    assert shlex.split(made.preparation(2, 2))[-3:] == ["--prepare", "--shard", "2/2"]
    assert "--shard" not in made.chunk(1, 1)
    merged = made.merge()
    assert "--only-merge" in merged and merged.endswith("/chunks/*-of-*/")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"outptu": "x"}, "outptu"),
        ({"file": ""}, "no file"),
        ({"file": "nowhere.toml"}, "nowhere.toml"),
        ({"output": None}, "no output"),
        ({"chunk_minutes": 0}, "chunk_minutes"),
        ({"trial_jobs": 2.5}, "trial_jobs"),
        ({"threads": True}, "threads"),
        ({"options": "--mix-builds"}, "options"),
    ],
)
def test_settings_that_are_none_are_refused_by_name(tmp_path, wrong, said):
    with pytest.raises(SystemExit) as refused:
        sweep(tmp_path, **wrong)
    text = str(refused.value)
    assert said in text and "found" in text and "expected" in text, text


def test_a_program_that_fails_ends_the_trial(tmp_path):
    made = sweep(tmp_path)
    made.program = f"{sys.executable} -c 'import sys; sys.exit(\"error: the place: found this\")'"
    with pytest.raises(SystemExit) as ended:
        chunks.trial(made, tmp_path / "chunks.json")
    assert "status 1" in str(ended.value) and not (tmp_path / "chunks.json").exists()
