"""Flicker too faint to be that of a lamp."""

# What an exposure of a whole number of the flicker's periods leaves of it goes as the grid's
# deviation: less than 3e-4 of the light for a lamp that flickers by a third, 60 mHz off. Nobody
# should rest a claim on it: its phase jumps by half a turn where the grid passes its nominal.
MIN_FLICKER_RATIO = 3e-4
FAINT = (
    "hardly any flicker: an exposure of a whole number of its periods (anti-flicker), or a nearly "
    "steady light"
)
