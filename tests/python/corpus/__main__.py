"""`python -m corpus`: see the package."""

import argparse
import sys
from pathlib import Path

import bpy

import corpus
from corpus.run import run
from corpus.table import table


def main():
    """Run files of the corpus; exit status 0 where all agree or are refused as documented."""
    parser = argparse.ArgumentParser(prog="python -m corpus", description=corpus.__doc__)
    parser.add_argument("names", nargs="*", help="files; without names all")
    parser.add_argument("--folder", type=Path, default=Path("out/corpus"), help="where everything is written")
    parser.add_argument("--table", type=Path, help="also write the Markdown of docs/corpus.md to this file")
    parser.add_argument("--no-pictures", action="store_true", help="export and probe only")
    parser.add_argument("--reuse", action="store_true", help="take Cycles' pictures that --folder has")
    parser.add_argument("--threads", type=int, default=2, help="files at the same time")
    arguments = parser.parse_args()
    entries = [corpus.FILES[name] for name in arguments.names] or list(corpus.FILES.values())
    folder = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for entry in entries:
        corpus.write(entry, folder)
    outcomes = []
    pictures = not arguments.no_pictures
    for outcome in run(folder, entries, lambda _: pictures, arguments.threads, arguments.reuse):
        outcomes.append(outcome)
        print(
            f"{outcome.entry.name}: {outcome.verdict}\n{outcome.describe()}".strip(),
            file=sys.stderr,
            flush=True,
        )
    text = table(outcomes, f"Cycles {bpy.app.version_string}")
    print(text)
    if arguments.table is not None:
        arguments.table.write_text(text, encoding="utf-8")
    return 0 if all(outcome.as_documented for outcome in outcomes) else 1


sys.exit(main())
