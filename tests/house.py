"""Measures of the house: how many files, how they hang together, what is documented, which words.

``python -m tests.house`` prints them; :mod:`tests.test_house` holds the line.
"""

from __future__ import annotations

import ast
import re
import statistics
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SMALL = 60  # lines
# Of the field, for what there is in the code: each is to be found.
TERMS = (
    "Ornstein", "CUSUM", "Jacobian", "posterior", "forward selection", "watchdog", "backpressure",
)  # fmt: skip
SOURCE = re.compile(r"\b(?:Eqs?\.|equation|et al\.|RFC|ITU|ENFSI|(?:19|20)\d\d\b.*\)|vol\.|IEEE)")


def modules() -> dict[str, Path]:
    """Return the modules of rsenf and nodes by name."""
    out = {}
    for path in sorted([*ROOT.glob("rsenf/**/*.py"), *ROOT.glob("nodes/**/*.py")]):
        parts = list(path.relative_to(ROOT).with_suffix("").parts)
        parts[0] = {"nodes": "rsenf_nodes"}.get(parts[0], parts[0])
        out[".".join(parts[: -1 if parts[-1] == "__init__" else None])] = path
    return out


def imported(tree: ast.AST, known: dict[str, Path], *, at_once: bool = False) -> set[str]:
    """Return the known modules that a module imports; ``at_once``: when it is itself imported."""
    nodes = tree.body if at_once and isinstance(tree, ast.Module) else ast.walk(tree)
    out = set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            full = {f"{node.module}.{alias.name}" for alias in node.names}
            out |= (full & known.keys()) or ({node.module} & known.keys())
        elif isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names} & known.keys()
    return out


def circles(uses: dict[str, set[str]]) -> list[list[str]]:
    """Return modules that import each other in a circle, depth first."""
    done: set[str] = set()
    found = []

    def visit(name: str, way: list[str]) -> None:
        if name in way:
            found.append(way[way.index(name) :])
        elif name not in done:
            for other in sorted(uses[name]):
                visit(other, [*way, name])
            done.add(name)

    for name in sorted(uses):
        visit(name, [])
    return found


def public(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """Yield functions and methods that others may call."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from (n for n in node.body if isinstance(n, ast.FunctionDef))


def code_lines(text: str, tree: ast.AST) -> int:
    """Return how many lines hold code: no blank ones, comments or docstrings."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docs: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, kinds) and ast.get_docstring(node, clean=False) is not None:
            docs.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    lines = enumerate(text.splitlines(), 1)
    return sum(bool(s := line.strip()) and s[0] != "#" and at not in docs for at, line in lines)


def measured() -> dict[str, float]:
    """Return every measure by name."""
    known = modules()
    texts = {name: path.read_text(encoding="utf-8") for name, path in known.items()}
    trees = {name: ast.parse(text) for name, text in texts.items()}
    plain = [name for name, path in known.items() if not path.name.startswith("__")]
    uses = {name: imported(tree, known) for name, tree in trees.items()}
    lines = {name: len(text.splitlines()) for name, text in texts.items()}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    functions = [f for tree in trees.values() for f in public(tree) if not f.name.startswith("_")]
    taking = [f for f in functions if {a.arg for a in f.args.args} - {"self", "cls"}]
    docs = {f: ast.get_docstring(f) or "" for f in functions}
    classes = Counter(n.name for t in trees.values() for n in t.body if isinstance(n, ast.ClassDef))
    every = "\n".join(texts.values()).lower()
    return {
        "files": len(known),
        "lines": sum(lines.values()),
        "lines of code": sum(code_lines(texts[name], trees[name]) for name in known),
        "median lines": statistics.median(lines[name] for name in plain),
        "longest": max(lines.values()),
        "files with one importer": sum(
            sum(name in of for of in uses.values()) == 1 for name in plain
        ),
        f"files under {SMALL} lines": sum(lines[name] < SMALL for name in plain),
        "class names twice": sum(count > 1 for count in classes.values()),
        "import circles": len(
            circles({n: imported(t, known, at_once=True) - {n} for n, t in trees.items()})
        ),
        "README lines": len(readme.splitlines()),
        "README words": len(readme.split()),
        "% with parameters documented": 100.0
        * sum("Parameters\n" in docs[f] for f in taking) / len(taking),
        "% with an example": 100.0 * sum(">>>" in docs[f] for f in functions) / len(functions),
        "% citing a source": 100.0
        * sum(bool(SOURCE.search(docs[f])) for f in functions) / len(functions),
        "terms missing": sum(term.lower() not in every for term in TERMS),
    }  # fmt: skip


if __name__ == "__main__":
    for measure, value in measured().items():
        print(f"{measure:<32}{value:10.1f}" if value % 1 else f"{measure:<32}{value:8.0f}")
