"""Rebuilds the figures and tables of the documents from committed records, and says what was changed.

`parity/paper.toml` lists every figure and table; docs/replicability.md is for users. The scripts that draw
the program's own figures (blend/) and the notebooks' rule for figures with an uncertainty are used as they
are.
"""

import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]

for folder in ("blend", "notebooks"):
    if str(ROOT / folder) not in sys.path:
        sys.path.append(str(ROOT / folder))
