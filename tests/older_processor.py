"""This processor without its newest instruction sets, for NumPy and OpenBLAS.

    env $(python -m tests.older_processor) python -m pytest tests/golden

On x86-64 all above AVX2 are turned off. Where there are none, or it is another kind of processor,
all go that NumPy can do without.
"""

from __future__ import annotations

import os
import platform

import numpy as np

OFF, CORE = "NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE"
BELOW_AVX512, LEAST = "Haswell", {"x86_64": "Nehalem", "aarch64": "ARMV8"}  # as OpenBLAS has them


def variables() -> dict[str, str]:
    """Return what to set in the environment: it takes effect when NumPy is imported."""
    on = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    newest = [name for name in on if name == "X86_V4" or name.startswith("AVX512")]
    off = [*os.environ.get(OFF, "").replace(",", " ").split(), *(newest or on)]
    core = BELOW_AVX512 if newest else LEAST.get(platform.machine(), "")
    return {OFF: ",".join(off), **({CORE: core} if core else {})}


if __name__ == "__main__":
    print(*(f"{name}={value}" for name, value in variables().items()))
