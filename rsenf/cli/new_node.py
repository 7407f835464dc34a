"""Write a template of an external node, NAME.py, which runs unchanged.

It reads a camera's estimates and raises alarms; change its stage, and keep the rest.
"""

from __future__ import annotations

import argparse
import keyword
from pathlib import Path

TEMPLATE, ITS_NAME = "node_template.py", "own_node.py"
# A script's folder comes first in the module search path: such a file would hide these packages.
TAKEN = ("rsenf", "rsenf_nodes", "zenoh")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("name", metavar="NAME", help="of the node, and of its file")
    parser.add_argument("--dir", type=Path, default=Path(), metavar="DIR", help="where to (here)")


def run(args: argparse.Namespace) -> int:
    """Write the file, and print what to do next."""
    from importlib.resources import files

    from rsenf.errors import EXIT_DONE, UsageError

    name, path = args.name, args.dir / f"{args.name}.py"
    if not name.isidentifier() or keyword.iskeyword(name) or name in TAKEN:
        raise UsageError(f"{name!r} can't be the name of a module", "such as my_band")
    text = files("rsenf.run").joinpath(TEMPLATE).read_text(encoding="utf-8")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text.replace(ITS_NAME, path.name))
    except FileExistsError as exc:
        raise UsageError(f"{path} exists already", "choose another name") from exc
    except OSError as exc:
        raise UsageError(f"{path} can't be written: {exc.strerror}", "another --dir") from exc
    print(
        f"{path}: written. It runs as it is:\n"
        f"  rsenf contract --reads cam1/track --sends cam1/alarm -- python {path}\n"
        f"In a graph, under 'nodes':\n"
        f"  {name}: {{kind: external, command: [python, {path}],\n"
        f"    reads: [cam1/track], sends: [cam1/alarm]}}\n"
        f"What nodes owe each other: rsenf explain contract"
    )
    return EXIT_DONE
