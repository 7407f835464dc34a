"""A model as readable YAML: long lists and numbers are shortened."""

from __future__ import annotations

from typing import Any

import yaml

from rsenf.model import CaptureModel

DIGITS = 7
FEW = 6  # longest list that is printed in full


def model_text(model: CaptureModel) -> str:
    """Return a model as YAML; of long lists only the first values and the length."""
    return yaml.safe_dump(_short(model.to_dict()), sort_keys=False, width=90, allow_unicode=True)


def _short(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _short(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        first = [_short(item) for item in value[:FEW]]
        return first if len(value) <= FEW else [*first[:2], f"… {len(value)} in all"]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
