"""Some 120 .blend files like those that people make, and what becomes of each.

`FILES` holds them by name; `write` makes one. `python -m corpus` (with tests/python and blend in PYTHONPATH)
runs them all and prints the table of docs/corpus.md.
"""

from corpus import clouds, effects, frames, graphs, objects, refusals, strangers  # noqa: F401  they fill the registry
from corpus.registry import FILES, File, write

__all__ = ["FILES", "File", "write"]
