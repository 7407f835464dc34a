"""Check that a program fulfils the contract of nodes ('rsenf explain contract').

    rsenf contract --reads cam/track --sends cam/alarm -- python my_node.py

The program is started on a private bus (its address is in RSENF_CONNECT), gets valid, broken,
foreign and oversized messages, and is stopped. Exit code 1 if it violates a point.
"""

from __future__ import annotations

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("--reads", action="append", default=[], metavar="CAMERA/TOPIC")
    parser.add_argument("--sends", action="append", default=[], metavar="CAMERA/TOPIC")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("command", nargs="+", metavar="COMMAND")


def run(args: argparse.Namespace) -> int:
    """Check a program."""
    from rsenf.cli.console import print_json
    from rsenf.errors import EXIT_DONE, EXIT_FAILED
    from rsenf.run.contract import check_contract

    checks = check_contract(args.command, args.reads, args.sends)
    if args.json:
        print_json([{"check": c.name, "passed": c.passed, "detail": c.detail} for c in checks])
    else:
        for check in checks:
            why = f": {check.detail}" if check.detail and not check.passed else ""
            print(f"{'kept  ' if check.passed else 'BROKEN'}  {check.name}{why}")
    return EXIT_DONE if all(check.passed for check in checks) else EXIT_FAILED
