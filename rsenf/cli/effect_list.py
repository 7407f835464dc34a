"""The catalogue of effects, to read."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import textwrap
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.model import Effect

_WIDTH = 100


class ListEffects(argparse.Action):
    """An option that prints the catalogue and ends the program."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Print all effects, those of ``--effects`` files given before included."""
        from rsenf.model import CATALOGUE, load_effects

        for path in namespace.effects:
            load_effects(path)
        print("\n\n".join(describe(effect) for effect in CATALOGUE.values()))
        parser.exit()


def describe(effect: type[Effect]) -> str:
    """Return what an effect says of itself, with its parameters and their plausible ranges."""
    told = [effect.name, *_wrapped(inspect.getdoc(effect) or "")]
    for f in dataclasses.fields(effect):
        low, high = f.metadata["low"], f.metadata["high"]
        number = isinstance(f.default, int | float) and not isinstance(f.default, bool)
        choices = ", ".join(f.metadata["choices"])
        within = f", {low:g} to {high:g}" if number else f" ({choices})" if choices else ""
        told.append(f"    {f.name} = {f.default}: {f.metadata['doc']}{within}")
    told += _wrapped(f"Known from: {effect.source}.")
    told += _wrapped(
        f"Looks like: {', '.join(effect.confused_with)}. Told by: {effect.told_apart_by}."
    )
    return "\n".join(told)


def _wrapped(text: str) -> list[str]:
    paragraphs = text.replace("``", "").split("\n\n")
    return [
        line
        for paragraph in paragraphs
        for line in textwrap.wrap(paragraph, _WIDTH, initial_indent="  ", subsequent_indent="  ")
    ]
