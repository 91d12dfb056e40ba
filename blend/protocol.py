"""How the scripts of this folder talk to their caller.

A script reads one JSON request from stdin and answers with one JSON object per line: `hello` first, then
`activity` (what it works at, for the case that it dies), `progress` and `warning`, and last `done` (exit
status 0) or `error` (exit status 1; it can be the first; further faults of the input are its `others`). A
script that converses reads a request per line, answers each with `done`, and ends with its input or at the
first `error`. The answers go to the file descriptor given as first argument, or to stdout. Blender prints to
stdout as it likes, so file descriptor 1 is pointed at stderr before anything else and the answers use a
duplicate of the old one.

This module must not import bpy: a missing bpy is one of the errors that it reports.
"""

import json
import os
import platform
import sys
import traceback
from contextlib import contextmanager, suppress

# Innermost calls of an unexpected exception that an error names.
SHOWN_CALLS = 3


class InputError(Exception):
    """An input that cannot be used: where it stands, what was found, what was expected, what to do."""

    def __init__(self, place, found, expected, remedy):
        super().__init__(f"{place}: found {found}, expected {expected}; {remedy}")
        self.place = place
        self.found = found
        self.expected = expected
        self.remedy = remedy
        # Further faults of the same input.
        self.others = []

    def parts(self):
        """The fields of an `error` event."""
        fields = ("place", "found", "expected", "remedy")
        return {name: getattr(self, name) for name in fields} | (
            {"others": [other.parts() for other in self.others]} if self.others else {}
        )


class Faults:
    """Collects the faults of an input, so that whoever mends it learns of all at once."""

    def __init__(self):
        self.found = []

    @contextmanager
    def noted(self):
        """Keep an InputError of the block and go on after it."""
        try:
            yield
        except InputError as error:
            self.note(error)

    def note(self, error):
        """Keep an InputError; each is reported once."""
        for fault in (error, *error.others):
            if all(str(other) != str(fault) for other in self.found):
                self.found.append(fault)

    def require_none(self):
        """Raise all that were kept as one InputError."""
        if self.found:
            first, *others = self.found
            first.others = others
            raise first


class Messages:
    """Writes the events of the protocol, one JSON object per line, to an open text stream."""

    def __init__(self, stream):
        self._stream = stream

    def send(self, event, **fields):
        """Write one event."""
        self._stream.write(json.dumps({"event": event, **fields}, ensure_ascii=False) + "\n")
        self._stream.flush()

    def progress(self, done, what):
        """Report that the fraction `done` (0..1) of the work is finished; `what` says which work."""
        self.send("progress", done=round(float(done), 4), what=what)

    def activity(self, what):
        """Report what is begun, as "opening FILE": the caller's words where this process dies at it."""
        self.send("activity", what=what)

    def warning(self, place, message):
        """Report something that was left out or changed and does not stop the work."""
        self.send("warning", place=place, message=message)

    def error(self, error):
        """Report the InputError that stopped the work."""
        self.send("error", **error.parts())


class Located(dict):
    """A JSON object that knows its place in the document, so that a missing key can be reported with it."""

    place = ""

    def __missing__(self, key):
        raise InputError(
            f"{self.place}.{key}",
            "no such key",
            f"`{key}` beside {', '.join(sorted(self)) or 'nothing'}",
            "add the key to the document",
        )


def located(value, place):
    """Return `value` (parsed JSON) with every object in it turned into a Located."""
    if isinstance(value, dict):
        result = Located({key: located(item, f"{place}.{key}") for key, item in value.items()})
        result.place = place
        return result
    if isinstance(value, list):
        return [located(item, f"{place}[{index}]") for index, item in enumerate(value)]
    return value


def serve(script, handle, before_bpy=None, needs_bpy=True, reads=None):
    """Run one script: read the request, call `handle(request, messages)`, send its return value as result.

    `before_bpy(request)` runs before bpy is imported, for checks of the environment that Blender reads when
    it starts. A script with `needs_bpy=False` runs where bpy is missing, and its `hello` names no Blender.
    `reads(request)` lists the user's files that are read: what a library raises at one of them is an error of
    the file. Does not return: exits with status 0 or 1.
    """
    files = []

    def answer(messages):
        request = _parse(sys.stdin.read())
        if before_bpy is not None:
            before_bpy(request)
        blender = _blender_version() if needs_bpy else None
        messages.send("hello", blender=blender, python=platform.python_version())
        if reads is not None:
            files.extend(reads(request))
        messages.send("done", result=handle(request, messages))

    _guard(script, answer, files)


def converse(script, handle):
    """Run one script that answers a request per line of stdin with `handle(request, messages)`, without bpy.

    Does not return: exits with status 0 at the end of the input, with 1 at the first error.
    """

    def answer(messages):
        messages.send("hello", blender=None, python=platform.python_version())
        for line in sys.stdin:
            messages.send("done", result=handle(_parse(line), messages))

    _guard(script, answer)


def _guard(script, answer, files=()):
    messages = Messages(_message_stream())
    try:
        answer(messages)
        status = 0
    except InputError as error:
        messages.error(error)
        status = 1
    except Exception as error:
        messages.error(_unexpected(script, error, files))
        status = 1
    _leave(status)


def _leave(status):
    """End the process with everything written and no destructor run: Blender's may abort, and the answer is
    given."""
    for stream in (sys.stdout, sys.stderr):
        # Where nobody reads it any more, it is not needed.
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(status)


def _unexpected(script, error, files):
    """The InputError for any other exception: of the files that were read, or else of the script."""
    place = ", ".join(str(file) for file in files[:SHOWN_CALLS]) or script
    if len(files) > SHOWN_CALLS:
        place += f" and {len(files) - SHOWN_CALLS} more"
    if isinstance(error, MemoryError):
        return InputError(
            place,
            f"contents that need more memory than there is to read them ({error or 'no figure'})",
            "a file that is whole and fits the memory",
            "write it again; where it is whole, set CLOUDPARITY_READ_GIB to more",
        )
    text = " ".join(str(error).split())
    calls = [
        f"{os.path.basename(call.filename)} line {call.lineno}"
        for call in reversed(traceback.extract_tb(error.__traceback__)[-SHOWN_CALLS:])
    ]
    found = f"{type(error).__name__}: {text} ({', called from '.join(calls)})"
    if files:
        remedy = "write it again; where it is whole, this is a defect: report it with the file"
        return InputError(place, found, "a file that is whole", remedy)
    return InputError(
        place, found, "no exception", "this is a defect of the script: report it with the input"
    )


def _message_stream():
    real_stdout = os.dup(1)
    os.dup2(2, 1)
    descriptor = int(sys.argv[1]) if len(sys.argv) > 1 else real_stdout
    # A name of a damaged file may be no text at all.
    return os.fdopen(descriptor, "w", encoding="utf-8", errors="replace")


def _parse(text):
    try:
        request = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"stdin, line {error.lineno}, column {error.colno}",
            error.msg,
            "one JSON document",
            "correct the request",
        ) from None
    if not isinstance(request, dict):
        raise InputError("stdin", f"a JSON {type(request).__name__}", "a JSON object", "correct the request")
    return located(request, "request")


def _blender_version():
    try:
        import bpy
    except ImportError as error:
        raise InputError(
            f"python interpreter {platform.python_version()}",
            f"bpy cannot be imported ({error})",
            "the Python module bpy: up to 5.0 for CPython 3.11, from 5.1 for CPython 3.13",
            "run `make setup`, or `python3.11 -m pip install bpy==5.0.1`",
        ) from None
    import older_releases

    older_releases.prepare()
    return bpy.app.version_string
