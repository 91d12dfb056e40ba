"""Files: read with errors that say what to do, hashed, written whole."""

import hashlib
import json
import os
import pathlib
import tempfile

from protocol import InputError


def sha256(path):
    """The hash of a file."""
    return hashlib.sha256(pathlib.Path(path).read_bytes()).hexdigest()


def read_text(path, expected, remedy):
    """The text of a file."""
    try:
        return pathlib.Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), expected, remedy) from None
    except UnicodeDecodeError:
        raise InputError(str(path), "bytes that are no UTF-8", expected, remedy) from None


def read_json(path, expected, remedy):
    """The JSON document of a file."""
    try:
        return json.loads(read_text(path, expected, remedy))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}, line {error.lineno}", error.msg, expected, remedy) from None


def write(path, content):
    """Write text or bytes: the file is whole or as it was."""
    path = pathlib.Path(path)
    content = content.encode("utf-8") if isinstance(content, str) else content
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".paper-", dir=path.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            pathlib.Path(temporary).unlink(missing_ok=True)
        found = error.strerror or str(error)
        raise InputError(
            str(path), found, "a writable file", "check the folder's rights and the space"
        ) from None


def json_text(document):
    """JSON for people and for version control."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"
