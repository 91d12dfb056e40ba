"""`make paper-full`: records from nothing, by the program, resumable; each compared with what is expected."""

import json
import os
import pathlib
import shutil
import subprocess

from paper import expected, files, listing, rebuild
from protocol import InputError

DONE = "done.json"


def build_of(program):
    """The identity of the program's build."""
    remedy = "build it: `make build`"
    try:
        told = subprocess.run([program, "doctor", "--json"], capture_output=True, text=True, check=False)
        return json.loads(told.stdout)["build"]
    except OSError as error:
        raise InputError(str(program), error.strerror or str(error), "the program", remedy) from None
    except (json.JSONDecodeError, KeyError, TypeError):
        raise InputError(
            f"{program} doctor --json", "no identity of the build", "the key build", remedy
        ) from None


def run(root, program, names, out, say, take=False):
    """Make records in a folder; return how many failed or are not as expected. `take`: they are committed."""
    found = listing.read(root)
    for name in names:
        if name not in found.records:
            raise InputError(
                "RECORD", repr(name), f"one of {', '.join(found.records)}", "name one of the list"
            )
    program = pathlib.Path(program).absolute()
    build = build_of(program)
    pairs, _ = listing.matched(found)
    wanted = expected.read(root) if (root / expected.FILE).exists() else []
    bad, documents, taken = 0, {}, []
    for name in names or found.records:
        record = found.records[name]
        # Experiments refuse a folder that another build began.
        folder = out / name / build.rpartition("+")[2][:12]
        made = _make(root, program, build, record, folder, say)
        if made is None:
            bad += 1
            continue
        documents[name] = (made, json.loads(made.read_text(encoding="utf-8")))
        if take:
            files.write(root / record.file, made.read_bytes())
            taken.append(name)
    for entry, table in pairs:
        parts = listing.names_of(entry)
        if not set(parts) & set(documents):
            continue
        of = {name: documents[name][1] if name in documents else _committed(found, name) for name in parts}
        document = of if len(of) > 1 else next(iter(of.values()))
        drawn = rebuild.drawn_of(entry, table, document, root)
        keys = {expected.key_of(row, entry.keys) for row in drawn.rows}
        # Tables of every heading share a name: what others of them expect is not missing here.
        here = [one for one in wanted if entry.heading != "*" or one.row in keys]
        problems, compared = expected.compare(entry.name, drawn, entry.keys, here)
        for problem in problems:
            say(f"DIFFERS  {entry.name}: {problem}")
        bad += bool(problems) and not take
        if compared and not problems:
            say(f"agrees   {entry.name}: {compared} values within their tolerances")
    if taken:
        for changed in rebuild.accept(root, taken):
            say(f"written  {changed}")
    return bad


def _committed(found, name):
    record = found.records[name]
    return files.read_json(found.root / record.file, "a record", f"make it: `make paper-full RECORD={name}`")


def _make(root, program, build, record, folder, say):
    """The path of a record that is made, by this build or now; None where a command failed."""
    made = folder / "record.json"
    done = folder / DONE
    commands = [command.replace("{out}", str(folder)) for command in record.commands]
    if done.is_file() and made.is_file():
        state = json.loads(done.read_text(encoding="utf-8"))
        if state == {"build": build, "commands": commands, "sha256": files.sha256(made)}:
            say(f"there    {record.name}: made by this build before")
            return made
    folder.mkdir(parents=True, exist_ok=True)
    say(f"making   {record.name}: {record.what} ({record.takes})")
    environment = dict(os.environ, PATH=f"{program.parent}{os.pathsep}{os.environ.get('PATH', '')}")
    for command in commands:
        ended = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command], cwd=root, env=environment, check=False
        )
        if ended.returncode not in record.statuses:
            say(f"FAILED   {record.name}: exit status {ended.returncode} of {command}")
            return None
    sources = [folder / name for name in record.makes]
    missing = [path for path in sources if not path.is_file()]
    if missing:
        say(f"FAILED   {record.name}: the command did not write {missing[0]}")
        return None
    if len(sources) == 1:
        shutil.copyfile(sources[0], made)
    else:
        joined = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sources}
        files.write(made, files.json_text(joined))
    files.write(done, files.json_text({"build": build, "commands": commands, "sha256": files.sha256(made)}))
    return made
