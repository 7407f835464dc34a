"""The pages of help, which ``rsenf explain TOPIC`` shows: Markdown files, and plain texts."""

from __future__ import annotations

from pathlib import Path

# In the order in which a newcomer reads them; commands of later pages use files of earlier ones.
TOPICS = (
    "api", "verify", "references", "idle", "cameras", "live", "model", "discover", "batch",
    "graphs", "hosts", "recordings", "times", "dashboard", "extend", "errors", "results",
    "glossary", "changes", "licences",
)  # fmt: skip
PLAIN = ("exit-codes", "keys", "contract")


def page_of(topic: str) -> Path:
    """Return the file of a topic."""
    return Path(__file__).with_name(f"{topic}.md")


def title_of(topic: str) -> str:
    """Return the title of a topic's page."""
    with page_of(topic).open(encoding="utf-8") as page:
        return page.readline().removeprefix("# ").strip()


def plain_page(name: str) -> str:
    """Return a page that is plain text, one of ``PLAIN``."""
    return Path(__file__).with_name(f"{name}.txt").read_text(encoding="utf-8")
