"""The keys of report.json and their types."""

from __future__ import annotations

from typing import Any, Literal

from typing_extensions import TypedDict  # Pydantic's, before Python 3.12

from rsenf.report.verdict import EditJson

Comparison = TypedDict(
    "Comparison",
    {"for": str, "against": str, "log10_lr": float | None, "verbal": str, "sentence": str},
)


class RatioTexts(TypedDict):
    """Explanations of likelihood ratios, and the verbal scale."""

    meaning: list[str]
    method: str
    limit: str
    scale: list[dict[str, str]]
    scale_source: str


class Claim(TypedDict):
    """The evaluation of a claimed start."""

    start_utc: str | None
    verdict: str
    meaning: str
    among: str
    likelihood_ratios: list[Comparison]
    tolerance_s: float
    after_best_time_s: float | None


class PictureFile(TypedDict):
    """A picture beside the page."""

    sha256: str
    file: str
    title: str
    caption: str
    alt: str
    width_px: int
    height_px: int


class Quality(TypedDict):
    """How much of the signal is usable, and how precise it is."""

    values: int
    usable_values: int
    median_std_hz: float | None
    median_snr_db: float | None
    unusable_reasons: dict[str, int]


class Search(TypedDict):
    """Extent and result of the search."""

    method: str
    best_reference: str
    starts_compared: int
    seconds_used: float
    residual_std_hz: float | None
    expected_std_hz: float | None


class Inputs(TypedDict):
    """The input files, each with its SHA-256, and the file of the verdict."""

    recording: dict[str, Any]
    references: list[dict[str, Any]]
    verdict: dict[str, str]


class Document(TypedDict):
    """A report on the time of a recording."""

    schema: str
    version: int
    made_utc: str
    kind: Literal["investigative", "evaluative"]
    kind_meaning: str
    case: dict[str, str] | None
    question: str
    answer: str
    decision: str
    result: dict[str, Any]
    propositions: dict[str, str]
    likelihood_ratios: list[Comparison]
    likelihood_ratio_texts: RatioTexts
    conditions: list[str]
    claim: Claim | None
    edits: list[EditJson]
    what_would_help: list[str]
    pictures: list[PictureFile]
    pictures_left_out: str
    quality: Quality
    idle: dict[str, Any] | None
    search: Search
    warnings: list[str]
    limits: list[str]
    inputs: Inputs
    command: str
    parameters: dict[str, dict[str, Any]]
    versions: dict[str, str]
    glossary: dict[str, str]
    files: list[str]
