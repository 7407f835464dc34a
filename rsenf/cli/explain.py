"""Explain a message, an exit code or the layout of keys; write the schemas.

rsenf explain                     what there is to explain
rsenf explain EnfEstimate         the fields of a message, as Protobuf with units
rsenf explain exit-codes | keys
rsenf explain schemas --out DIR   write rsenf.proto, rsenf.desc and graph.schema.json
"""

from __future__ import annotations

import argparse
from pathlib import Path

EXIT_CODES = """\
0    done; 'no usable signal', 'no match' and 'too short to tell' are results too
1    failed: no decodable frame, a source that can't be reached, a node that died, a full disk
2    usage or configuration: the command, its arguments or a file of settings
3    done with loss: the input was truncated or damaged, the result says where
130  interrupted"""

KEYS = """\
rsenf/<site>/<camera>/frames     Frame          descriptor of a decoded picture
rsenf/<site>/<camera>/video      VideoPacket    compressed picture, for recording
rsenf/<site>/<camera>/rows       RowBlock       row means of the steady pixels
rsenf/<site>/<camera>/track      EnfEstimate    electric network frequency
rsenf/<site>/<camera>/idle       IdleEstimate   idle period of the camera
rsenf/<site>/<camera>/match      MatchResult    time of recording
rsenf/<site>/<camera>/live       Liveness       is the feed live
rsenf/<site>/<camera>/alarm      Alarm          something a person should see
rsenf/<site>/<camera>/discover   DiscoveryVerdict  what the model is missing
rsenf/<site>/reference/<grid>    ReferenceBlock grid frequency
rsenf/<site>/@nodes/<node>/health   Health      state of a node, every second
rsenf/<site>/@nodes/<node>/alive    (liveliness token)
'@nodes' is not matched by '*' or '**': ask for it by name."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("what", nargs="?", default="")
    parser.add_argument("--out", type=Path, metavar="DIR", help="for 'schemas'")


def run(args: argparse.Namespace) -> int:
    """Explain something."""
    from rsenf.errors import UsageError
    from rsenf.messages.proto_text import message_text
    from rsenf.messages.schema import message_classes

    classes = message_classes()
    topics = {"exit-codes": EXIT_CODES, "keys": KEYS}
    if not args.what:
        print("Messages:", ", ".join(classes))
        print("Also:    ", ", ".join([*topics, "schemas"]))
    elif args.what in classes:
        print(message_text(classes[args.what]))
    elif args.what in topics:
        print(topics[args.what])
    elif args.what == "schemas":
        if args.out is None:
            raise UsageError("explain schemas needs --out DIR")
        _write_schemas(args.out)
    else:
        raise UsageError(f"nothing to explain about {args.what!r}", "see 'rsenf explain'")
    return 0


def schema_files() -> dict[str, bytes]:
    """Generated files by name: the messages' schemas and the graph file's."""
    import json

    from rsenf.config import Graph
    from rsenf.messages import descriptor_set
    from rsenf.messages.proto_text import file_text

    graph = json.dumps(Graph.model_json_schema(), indent=2) + "\n"
    return {
        "rsenf.proto": file_text().encode(),
        "rsenf.desc": descriptor_set(),
        "graph.schema.json": graph.encode(),
    }


def _write_schemas(folder: Path) -> None:
    from rsenf.whole_file import whole_file

    folder.mkdir(parents=True, exist_ok=True)
    for name, content in schema_files().items():
        with whole_file(folder / name) as temporary:
            temporary.write_bytes(content)
        print(folder / name)
