"""Command blocks of the README and the pages of help: CI runs what they say and nothing else.

Blocks are fenced ``console`` blocks; lines that begin with ``$ `` are commands. A block may be
named by the HTML comment before it: ``<!-- test -->``. A block named ``not-run`` shows a command
that needs something a test machine hasn't got; its reason stands in the comment.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"


def pages() -> list[Path]:
    """Return the README, then the pages of help in their order."""
    # Read as text: this runs before anything is installed.
    listed = (ROOT / "rsenf/help/__init__.py").read_text(encoding="utf-8")
    topics = re.findall(
        r'"([a-z]+)"', listed[listed.index("TOPICS = (") : listed.index(")  # fmt")]
    )
    return [README, *(ROOT / f"rsenf/help/{topic}.md" for topic in topics)]


_BLOCK = re.compile(
    r"(?:<!-- *(?P<name>[\w-]+)(?::[^>]*)? *-->\n)?```console\n(?P<body>.*?)```", re.S
)


@dataclass(frozen=True)
class Block:
    """One fenced block."""

    name: str
    place: str
    commands: tuple[str, ...]


def blocks() -> list[Block]:
    """Return every command block, in order."""
    out = []
    for page in pages():
        text = page.read_text(encoding="utf-8")
        for match in _BLOCK.finditer(text):
            body = match["body"].replace("\\\n", " ")
            commands = tuple(ln[2:].strip() for ln in body.splitlines() if ln.startswith("$ "))
            line = text.count("\n", 0, match.start("body")) + 1
            out.append(Block(match["name"] or "", f"{page.name}:{line}", commands))
    return out


if __name__ == "__main__":
    wanted = sys.argv[-1]
    print("\n".join(c for b in blocks() if b.name == wanted for c in b.commands))
