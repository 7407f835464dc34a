"""The store: months and years of several grids, on disk, in UTC, read in slices.

::

    STORE/ce/1s/3f9a60c2d1e47b58.parquet      grid, step, and the hash of the imported file
    STORE/ce/0.1s/…

Each import is one file that never changes; it records what was read, how, and from which file.
Overlapping imports are merged on reading, by the rule for duplicates within a file. So importing a
file again changes nothing, a killed import leaves the store as it was, and removing its file undoes
an import.

Read ``sample_file`` (one import) first; then ``folder`` (series) and ``importer``; ``stored`` reads
and exports slices.
"""

from __future__ import annotations

from rsenf.reference.store.folder import (
    StoredSeries,
    all_series,
    coverage,
    default_store,
    facts,
    find_series,
)
from rsenf.reference.store.importer import Imported, import_file
from rsenf.reference.store.sample_file import SampleFile
from rsenf.reference.store.stored import StoredReference, export, open_grid

__all__ = [
    "Imported",
    "SampleFile",
    "StoredSeries",
    "StoredReference",
    "all_series",
    "coverage",
    "default_store",
    "export",
    "facts",
    "find_series",
    "import_file",
    "open_grid",
]
