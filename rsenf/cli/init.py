"""Write a graph that watches your cameras: verdicts, a page, an archive of the alarms.

Asks on a terminal for what no option gives, looks at each camera for some seconds, checks the
graph, and says the next command. Addresses with passwords go into FILE.env beside the graph, which
only you can read.
"""

from __future__ import annotations

import argparse
import importlib.util
import logging
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import unquote, urlsplit

from rsenf.bus.keys import is_name
from rsenf.cli.console import note, progress_bar, say, say_loss, tell
from rsenf.cli.options import named, positive
from rsenf.errors import EXIT_DONE, RsenfError, UsageError

if TYPE_CHECKING:
    from rsenf.api.probe import ProbeResult


METRICS = "127.0.0.1:9464"
AT_ONCE = 4  # cameras that are looked at


def add_init(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("--camera", action="append", default=[], type=named, metavar="NAME=URL",
                        help="a camera, rtsp://… or http://…; repeatable")  # fmt: skip
    parser.add_argument("--discover", action="store_true",
                        help="look for ONVIF cameras on the network first")  # fmt: skip
    _add_grid(parser)
    parser.add_argument("--reference", metavar="REF",
                        help="a growing CSV or WAV, sound:, topic:…, or the address of a camera "
                        "that can be trusted; without, the cameras judge each other")  # fmt: skip
    parser.add_argument("--folder", metavar="DIR",
                        help="archive of the minutes around alarms (archive)")  # fmt: skip
    parser.add_argument("--notify", action="append", default=[], metavar="TARGET",
                        help="who is told of alarms: https://…, mqtt://HOST, "
                        "mailto:TO?from=SENDER&host=SERVER, or a program; repeatable")  # fmt: skip
    parser.add_argument("--site", default="site", metavar="NAME", help="name of the whole (site)")
    parser.add_argument("--out", type=Path, default=Path("graph.yaml"), metavar="FILE",
                        help="the graph to write (graph.yaml)")  # fmt: skip
    parser.add_argument("--no-probe", dest="probe", action="store_false",
                        help="don't look at the cameras")  # fmt: skip
    _add_seconds(parser)
    parser.add_argument("--yes", action="store_true",
                        help="ask nothing; keep cameras that can't be reached now")  # fmt: skip
    parser.add_argument("--force", action="store_true", help="replace FILE")


def _add_grid(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--grid", type=float, choices=(50.0, 60.0), metavar="50|60",
                        help="nominal frequency in Hz; found from the data otherwise")  # fmt: skip


def _add_seconds(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=positive, default=10.0, metavar="S",
                        help="to look at a camera (10)")  # fmt: skip


def run_init(args: argparse.Namespace) -> int:
    """Write a graph for a site's cameras."""
    from rsenf.config import site_graph
    from rsenf.decode.source import cores

    secrets = args.out.with_suffix(".env")
    for path in (args.out, secrets):
        if path.exists() and not args.force:
            raise UsageError(f"{path} is there already", "--out another, or --force to replace it")
    asks = sys.stdin.isatty() and not args.yes
    site_graph.check_names([name for name, _ in args.camera])
    site_graph.check_reference(args.reference)
    targets = [site_graph.target_of(target) for target in args.notify]
    cameras = dict(args.camera)
    if args.discover:
        cameras |= _discovered(cameras, asks)
    elif not cameras and asks:
        cameras = _asked_cameras()
    if not cameras:
        raise UsageError("no camera", "--camera NAME=rtsp://…, or answer on a terminal")
    if asks:
        args.grid = args.grid or _asked_grid()
        args.reference = args.reference or _ask(
            "reference: a CSV or WAV that grows, sound:, a trusted camera's address; "
            "empty: the cameras judge each other",
            site_graph.check_reference,
        )
        args.folder = args.folder or _ask("folder for the minutes around alarms [archive]")
        targets += _asked_targets()
    if args.probe:
        cameras = _reached(cameras, args, asks)
    grid = {"nominal_hz": args.grid} if args.grid else {}
    settings = {"track": {"track": grid, "idle": dict(grid)}} if grid else {}
    page = importlib.util.find_spec("starlette") is not None
    nodes, variables = site_graph.without_passwords(
        {
            **site_graph.site_nodes(cameras, args.reference, settings, cores()),
            **site_graph.keeping(args.folder or "archive", targets, page=page),
        }
    )
    given = ["--env", str(secrets)] if variables else []
    words = ["rsenf", "run", str(args.out), *given, "--metrics", METRICS]
    heading = ["Written by 'rsenf init'. Run it:", f"  {shlex.join(words)}"]
    if not page:
        heading.append("For a page of all feeds: pip install 'rsenf[dashboard]', and 'init' again.")
    _write(args.out, site_graph.graph_text(args.site, nodes, heading), secrets, variables)
    if not args.reference and len(cameras) == 1:
        note("one camera without a reference is tracked, not judged: give --reference")
    trackers = sum(node["kind"] == "track" for node in nodes.values())
    if trackers > 1:
        print(f"Track    {trackers} nodes share the cameras, at most one for each processor core")
    if page:
        print("Page     http://127.0.0.1:8780/")
    print(f"Metrics  http://{METRICS}/metrics")
    print(f"Next     {shlex.join(words)}")
    return EXIT_DONE


def _write(out: Path, text: str, secrets: Path, variables: Mapping[str, str]) -> None:
    """Write graph and variables, if the graph is fine; the variables for the owner alone."""
    from rsenf.config import load_graph
    from rsenf.whole_file import whole_file

    os.environ.update(variables)
    with whole_file(out) as new:
        new.write_text(text, encoding="utf-8")
        load_graph(new)
        if variables:
            with whole_file(secrets) as kept:
                kept.touch(mode=0o600)
                lines = (f"{name}={shlex.quote(value)}\n" for name, value in variables.items())
                kept.write_text("".join(lines), encoding="utf-8")


def _ask(what: str, check: Callable[[str], object] = str) -> str:
    """Ask until the answer is empty, or the check raises no UsageError."""
    while True:
        print(f"{what}: ", end="", file=sys.stderr, flush=True)
        answer = sys.stdin.readline().strip()
        try:
            if answer:
                check(answer)
            return answer
        except UsageError as exc:
            say(str(exc))


def _discovered(known: Iterable[str], asks: bool) -> dict[str, str]:
    """Look for cameras on the network, and ask for their streams, which they don't tell."""
    from rsenf.config.site_graph import check_names

    found = find_cameras()
    for camera in found:
        say(f"found {camera.name} at {camera.host}")
    if not found:
        say("found no ONVIF camera that answers")
    elif not asks:
        raise UsageError("their streams aren't known", "--camera NAME=rtsp://HOST/…, for each")
    check_names([*known, *(camera.name for camera in found)])
    return {
        camera.name: url
        for camera in found
        if (url := _ask(f"address of {camera.name}'s stream, rtsp://{camera.host}/… (empty: none)"))
    }


def _asked_cameras() -> dict[str, str]:
    from rsenf.config.site_graph import check_names

    cameras: dict[str, str] = {}
    while url := _ask(f"address of camera {len(cameras) + 1} (empty: no more)"):
        number = next(n for n in count(len(cameras) + 1) if f"cam{n}" not in cameras)
        name = _ask(f"its name [cam{number}]", lambda name: check_names([*cameras, name]))
        cameras[name or f"cam{number}"] = url
    return cameras


def _asked_targets() -> list[dict[str, Any]]:
    from rsenf.config.site_graph import TARGETS, target_of

    targets: list[dict[str, Any]] = []
    while target := _ask(f"who is told of alarms: {TARGETS} (empty: done)", target_of):
        targets.append(target_of(target))
    return targets


def _asked_grid() -> float | None:
    while answer := _ask("grid, 50 or 60 Hz (empty: found from the light)"):
        if answer in ("50", "60"):
            return float(answer)
    return None


def _reached(cameras: Mapping[str, str], args: argparse.Namespace, asks: bool) -> dict[str, str]:
    """Look at each camera; return those to keep.

    Raises
    ------
    RsenfError
        When one can't be reached, and nobody is there to ask.
    """
    kept: dict[str, str] = {}
    lost = 0
    for (name, url), found in zip(cameras.items(), _looked([*cameras.values()], args), strict=True):
        if isinstance(found, RsenfError):
            lost += 1
            say(f"{name}: {found}")
            if asks and _ask(f"keep {name}? [y/N]").lower() not in ("y", "yes"):
                continue
        else:
            print(f"{name}: {found}", file=sys.stderr)
        kept[name] = url
    if lost and not (asks or args.yes):
        raise RsenfError(f"{lost} of {len(cameras)} cameras can't be used now", "--yes keeps them")
    return kept


def _looked(urls: Sequence[str], args: argparse.Namespace) -> list[ProbeResult | RsenfError]:
    """Probe sources, some at once; the first Ctrl-C ends it early."""
    from rsenf.api.probe import probe
    from rsenf.run.process import interruptible

    done_s = [0.0] * len(urls)
    with (
        interruptible() as stop,
        progress_bar("looking", args.seconds * len(urls)) as progress,
        ThreadPoolExecutor(AT_ONCE) as pool,
    ):

        def look(number: int) -> ProbeResult | RsenfError:
            def show(seconds: float) -> None:
                done_s[number] = seconds
                progress(sum(done_s))

            try:
                return probe(
                    urls[number], seconds=args.seconds, nominal_hz=args.grid, stop=stop,
                    progress=show,
                )  # fmt: skip
            except RsenfError as exc:
                return exc

        return list(pool.map(look, range(len(urls))))


PROBE = """\
Look at a camera or a file for some seconds: what it sends, and what to change on it.

Says its codec, size and frame rate, whether its time stamps are steady, and whether the flicker of
the light is seen or swallowed by the exposure. Seconds may be too few to tell. Exit code 1: it
can't be opened; 3: it broke off, or frames were damaged."""


def add_probe(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("url", metavar="URL", help="rtsp://…, http://…, /dev/video0, or a file")
    _add_seconds(parser)
    _add_grid(parser)
    parser.add_argument("--json", action="store_true", help="as JSON")


def run_probe(args: argparse.Namespace) -> int:
    """Look at a camera."""
    (found,) = _looked([args.url], args)
    if isinstance(found, RsenfError):
        raise found
    tell(args, found.to_dict(), found, found.warnings)
    return say_loss(found.recording, found)


TRANSMITTER = "http://www.onvif.org/ver10/network/wsdl", "NetworkVideoTransmitter"
NAMED = "onvif://www.onvif.org/name/"
ANSWER_S = 4  # time for their answers


class FoundCamera(NamedTuple):
    """A camera that has answered: a name that suits a graph, and its host."""

    name: str
    host: str


def find_cameras() -> list[FoundCamera]:
    """Ask all ONVIF cameras on the local network to answer.

    Raises
    ------
    UsageError
        When the package isn't installed, or the network can't be asked.
    """
    try:
        from wsdiscovery import QName
        from wsdiscovery.discovery import ThreadedWSDiscovery
    except ImportError as exc:
        raise UsageError("wsdiscovery is not installed", "pip install 'rsenf[onvif]'") from exc
    logging.getLogger("threading").setLevel(logging.CRITICAL)  # it warns of every odd interface
    asking = ThreadedWSDiscovery()
    try:
        asking.start()
        answers = asking.searchServices(types=[QName(*TRANSMITTER)], timeout=ANSWER_S)
    except OSError as exc:
        raise UsageError(f"the network can't be asked: {exc.strerror}", "--camera NAME=…") from exc
    finally:
        asking.stop()
    return named_cameras(
        (urls, [str(scope) for scope in answer.getScopes()])
        for answer in answers
        if (urls := answer.getXAddrs())
    )


def named_cameras(answers: Iterable[tuple[list[str], list[Any]]]) -> list[FoundCamera]:
    """Return a camera for each host, in the order of the hosts.

    Parameters
    ----------
    answers : iterable
        Of each answer the addresses of its device service, and its scopes.

    Examples
    --------
    >>> named_cameras([(["http://10.0.0.7/onvif/device_service"], [NAMED + "Front%20door"])])
    [FoundCamera(name='Front-door', host='10.0.0.7')]
    """
    found: dict[str, str] = {}
    for urls, scopes in answers:
        host = urlsplit(urls[0]).hostname or ""
        said = next((s.removeprefix(NAMED) for s in scopes if s.startswith(NAMED)), "")
        name = re.sub(r"[^A-Za-z0-9_-]+", "-", unquote(said)).strip("-")[:32]
        name = name if is_name(name) else "camera"
        if host and host not in found:
            numbered = (name if n == 1 else f"{name}-{n}" for n in count(1))
            found[host] = next(one for one in numbered if one not in found.values())
    return [FoundCamera(found[host], host) for host in sorted(found)]
