"""A rolling-shutter camera from the physics, which shares nothing with rsenf's own model.

`film` turns a `Case` into row levels, stamps and the truth. `simple` is an older, plainer one.
"""

from .cases import Case, Filmed, film
from .effects import EFFECTS, Effect

__all__ = ["EFFECTS", "Case", "Effect", "Filmed", "film"]
