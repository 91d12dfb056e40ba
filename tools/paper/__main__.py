"""The command line: `python -m paper` rebuilds and compares, `full` makes records, `accept` takes what is."""

import argparse
import collections
import pathlib
import sys

from paper import ROOT, full, listing, rebuild
from protocol import InputError


def main(arguments=None):
    """Exit status 0: as the records give it; 1: something was changed; 2: an input that cannot be used."""
    parser = argparse.ArgumentParser(prog="python -m paper", description=__doc__)
    parser.add_argument("--root", type=pathlib.Path, default=ROOT, help="the project's folder")
    commands = parser.add_subparsers(dest="command")
    rebuilt = commands.add_parser("rebuild", help="rebuild figures and tables, and compare (default)")
    rebuilt.add_argument("-o", "--output", type=pathlib.Path, default=None)
    made = commands.add_parser("full", help="make records from nothing, and compare with what is expected")
    made.add_argument("--record", action="append", default=[], metavar="NAME")
    made.add_argument("--program", type=pathlib.Path, required=True)
    made.add_argument("-o", "--output", type=pathlib.Path, default=None)
    made.add_argument("--take", action="store_true", help="they become the committed records")
    taken = commands.add_parser("accept", help="take records, figures and tables as they are")
    taken.add_argument("names", nargs="*", metavar="RECORD")
    found = parser.parse_args(arguments)
    root = found.root.resolve()
    try:
        if found.command == "full":
            out = (found.output or root / "out/paper-full").absolute()
            bad = full.run(root, found.program, found.record, out, _say, found.take)
            return 1 if bad else 0
        if found.command == "accept":
            for name in rebuild.accept(root, found.names):
                print(f"written: {name}")
            return 0
        return _rebuild(root, getattr(found, "output", None) or root / "out/paper")
    except InputError as error:
        print(
            f"{error.place}\n  found: {error.found}\n  expected: {error.expected}\n  {error.remedy}",
            file=sys.stderr,
        )
        return 2


def _say(line):
    print(line, flush=True)


def _rebuild(root, out):
    lines = rebuild.run(root, out)
    changed = [line for line in lines if line.verdict == rebuild.CHANGED]
    # What matters most stands last, where a terminal ends.
    for verdict in (rebuild.TEXT, rebuild.KEPT, rebuild.REBUILT, rebuild.CHANGED):
        for line in lines:
            if line.verdict == verdict:
                print(line)
    counts = collections.Counter(line.verdict for line in lines)
    print(
        f"{counts[rebuild.REBUILT]} rebuilt from records and equal, {counts[rebuild.KEPT]} kept as accepted, "
        f"{counts[rebuild.TEXT]} tables of text, {len(changed)} changed; "
        f"{listing.LIST} has the list, {out} the files"
    )
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
