"""URDF files → `robodyn.model.Mechanism`: read strictly, every problem named with its line, nothing dropped in silence.

document.py   bytes → XML elements that know their line
grammar.py    URDF as a table: what a tag may hold, what it becomes, why the rest is ignored
check.py      the document against the table, and what no table can say: the tree, inertias, limits, mimics
ledger.py     what each tag became: honoured, ignored with a reason, or rejected
packages.py   mesh file names → files
assemble.py   the values, which yourdfpy reads → links and joints, depth first
read.py       all of it in a row
"""

from .read import read

__all__ = ["read"]
