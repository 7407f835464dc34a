"""Show a page of help, a message, the exit codes or the layout of keys; write the schemas.

rsenf explain                     list all topics
rsenf explain verify              a page of help
rsenf explain EnfEstimate         the fields of a message, as Protobuf with units
rsenf explain idle period         a term of the glossary, and the pages that use it most
rsenf explain exit-codes | keys | contract
rsenf explain schemas --out DIR   write rsenf.proto, rsenf.desc, and JSON Schemas of a graph file,
                                  a case file, a report, and what verbs print with --json
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import typing
from pathlib import Path
from typing import Any

from rsenf.cli.options import field_docs
from rsenf.errors import UsageError

_LISTS = ("glossary", "results", "changes", "licences")  # pages that explain no term
COMMENT = re.compile(r"<!--.*?-->\n?", re.S)  # for tests of the page, not for readers


def add_explain(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("what", nargs="*", help="a topic, message or term")
    parser.add_argument("--out", type=Path, metavar="DIR", help="for 'schemas'")


def run_explain(args: argparse.Namespace) -> int:
    """Print the explanation of a topic."""
    from rsenf.help import PLAIN, TOPICS, page_of, plain_page, title_of
    from rsenf.messages.schema import message_classes, message_text

    classes, what = message_classes(), " ".join(args.what)
    if not what:
        print("\n".join(f"{topic:<12}{title_of(topic)}" for topic in TOPICS))
        print("Messages:", ", ".join(classes))
        print("Also:    ", ", ".join([*PLAIN, "schemas"]))
    elif what in TOPICS:
        _show(page_of(what).read_text(encoding="utf-8"))
    elif what in classes:
        print(message_text(classes[what]))
    elif what in PLAIN:
        print(plain_page(what), end="")
    elif what == "schemas":
        if args.out is None:
            raise UsageError("explain schemas needs --out DIR")
        _write_schemas(args.out)
    else:
        pages = {topic: page_of(topic).read_text(encoding="utf-8") for topic in TOPICS}
        if not (lines := _term(pages, what)):
            raise UsageError(f"nothing to explain about {what!r}", "see 'rsenf explain'")
        print("\n".join(lines))
    return 0


def _term(pages: dict[str, str], term: str) -> list[str]:
    """Return a term's row of the glossary, in plain text, and the pages that use it most."""
    word = re.escape(term)
    row = re.search(rf"^\| ({word}) \| (.*) \|$", pages["glossary"], re.MULTILINE | re.IGNORECASE)
    uses = {
        topic: len(re.findall(rf"\b{word}\b", page, re.IGNORECASE))
        for topic, page in pages.items()
        if topic not in _LISTS
    }
    most = [topic for topic in sorted(uses, key=uses.__getitem__, reverse=True) if uses[topic]]
    found = [f"{row[1]}: {row[2]}"] if row else []
    return found + ([f"{term}: see rsenf explain {', '.join(most[:3])}"] if most else [])


def _show(page: str) -> None:
    """Print a page, rendered and paged on a terminal."""
    if not sys.stdout.isatty():
        print(page, end="")
        return
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console()
    with console.pager(styles=True):
        console.print(Markdown(COMMENT.sub("", page), hyperlinks=False))


def schema_files() -> dict[str, bytes]:
    """Return the generated files by name: schemas of messages, of files and of results."""
    from rsenf.config import Graph
    from rsenf.config.schemas import CaseFile
    from rsenf.messages import descriptor_set
    from rsenf.messages.schema import file_text

    files = {"graph": Graph.model_json_schema(), "case": CaseFile.model_json_schema()}
    schemas = files | result_schemas()
    return {
        "rsenf.proto": file_text().encode(),
        "rsenf.desc": descriptor_set(),
        **{f"{k}.schema.json": f"{json.dumps(v, indent=2)}\n".encode() for k, v in schemas.items()},
    }


def _write_schemas(folder: Path) -> None:
    from rsenf.whole_file import whole_file

    folder.mkdir(parents=True, exist_ok=True)
    for name, content in schema_files().items():
        with whole_file(folder / name) as temporary:
            temporary.write_bytes(content)
        print(folder / name)


JSON_SCHEMA = "https://json-schema.org/draft/2020-12/schema"


def result_schemas() -> dict[str, dict[str, Any]]:
    """Return the schemas by name. They allow further keys, since results may be extended."""
    from pydantic import TypeAdapter

    from rsenf.api.against import AgainstResult, TogetherResult
    from rsenf.api.idle import IdleComparison, IdleResult
    from rsenf.api.shared import json_fields
    from rsenf.api.track import EstimateJson, TrackResult
    from rsenf.api.verify import VerifyResult
    from rsenf.report.recording_time.document import Document

    documents = {
        "verify": ("rsenf verify --json", VerifyResult),
        "verify-against": ("rsenf verify --against --json", AgainstResult),
        "verify-together": ("rsenf verify --against --against --json", TogetherResult),
        "idle": ("rsenf idle --json", IdleResult),
        "idle-compared": ("rsenf idle A B --json", IdleComparison),
    }
    schemas = {}
    for name, (title, result) in documents.items():
        hints = typing.get_type_hints(result)
        schemas[name] = _schema(title, {f.name: hints[f.name] for f in json_fields(result)}, result)
    line = typing.get_type_hints(EstimateJson)
    schemas["track"] = _schema("a line of rsenf track --json", line, TrackResult)
    schemas["report"] = {"$schema": JSON_SCHEMA, **TypeAdapter(Document).json_schema()}
    return schemas


def _schema(title: str, hints: dict[str, Any], described_by: type) -> dict[str, Any]:
    """Return a schema of keys with their types, and the descriptions of a class's docstring."""
    from pydantic import BaseModel, Field, create_model

    docs = field_docs(described_by, "Attributes")
    fields: dict[str, Any] = {
        name: (hint, Field(description=docs.get(name) or None)) for name, hint in hints.items()
    }
    model: type[BaseModel] = create_model(title, **fields)
    return {"$schema": JSON_SCHEMA, **model.model_json_schema()}
