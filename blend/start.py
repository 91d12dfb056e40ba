"""Starts a script of this folder from memory, within limits, and ends it with the program that asked.

cloudparity runs `python -I -B -X utf8 -c THIS`. The first line of stdin is a JSON object: {"script": NAME,
"modules": {NAME: TEXT}, "parent": PROCESS, "memory": BYTES or null, "seconds": NUMBER or null}. The script
gets the rest. Scripts and the modules that they share are imported from these texts: nothing is unpacked, so
there is no folder in which another user could leave a module. An isolated interpreter (-I) has no other
either: not the working folder, not PYTHONPATH, PYTHONHOME or a user's own site-packages.

This file imports the standard library alone, and prints nothing.
"""

import importlib.abc
import importlib.util
import json
import os
import signal
import sys
import threading
import time
import types

SECONDS_BETWEEN_LOOKS = 0.5


class Scripts(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Finds modules among texts, before any folder is looked at."""

    def __init__(self, texts):
        self._texts = {name.removesuffix(".py"): text for name, text in texts.items()}

    def find_spec(self, fullname, path=None, target=None):
        """The module, where it is one of the texts."""
        if fullname not in self._texts:
            return None
        return importlib.util.spec_from_loader(fullname, self, origin=f"blend/{fullname}.py")

    def is_package(self, fullname):
        """No text is a package."""
        return False

    def get_source(self, fullname):
        """The text of a module."""
        return self._texts[fullname]

    def get_code(self, fullname):
        """The text of a module, compiled under the name that it has in the project."""
        return compile(self._texts[fullname], f"blend/{fullname}.py", "exec")


def end_with(parent):
    """End this process when the process `parent` ends, however that ends."""
    is_direct = os.getppid() == parent
    if is_direct and sys.platform == "linux":
        import ctypes

        # The kernel does it, even while a library works and holds the interpreter.
        set_parent_death_signal = 1
        ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(1)  # It ended before the kernel was asked.
        return
    if os.name == "posix":
        # Another system, or an interpreter that a script of the user's starts as a further process.
        threading.Thread(target=_watch, args=(parent, is_direct), daemon=True).start()


def _watch(parent, is_direct):
    while os.getppid() == parent if is_direct else _lives(parent):
        time.sleep(SECONDS_BETWEEN_LOOKS)
    os._exit(1)


def _lives(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def limit(memory, seconds):
    """Limit the address space (bytes) and the processors' time (seconds), where the system is Linux."""
    if sys.platform != "linux":
        return
    import resource

    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds)):
        if most is not None:
            _, hard = resource.getrlimit(kind)
            most = int(most) + 1
            resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def main():
    """Read what to start, and start it."""
    order = json.loads(sys.stdin.readline())
    end_with(order["parent"])
    limit(order["memory"], order["seconds"])
    scripts = Scripts(order["modules"])
    sys.meta_path.insert(0, scripts)
    sys.argv = [order["script"]]
    # A module of its own: the names of this file are not the script's.
    program = types.ModuleType("__main__")
    sys.modules["__main__"] = program
    exec(scripts.get_code(order["script"].removesuffix(".py")), program.__dict__)


if __name__ == "__main__":
    main()
