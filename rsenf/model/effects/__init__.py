"""The catalogue of effects: each a class with what it does, its source, and similar effects.

In: a place of the capture, such as the light on each line, and a :class:`Run`. Out: the same,
changed by the effect. Read ``base`` (kinds of effects, in the order of the capture) and
``catalogue`` (by name) first, then any effect, in the file of the place it acts at: ``shutter``,
``light``, ``scene``, ``sensor``, ``delivery``, ``codec``. ``search`` is what an effect derives
initial values from, and how a blind test draws its parameters.
"""

from rsenf.model.effects.base import (
    CodecEffect,
    DeliveryEffect,
    Effect,
    FrameEffect,
    LightEffect,
    ReadOutEffect,
    Run,
    SceneEffect,
    SensorEffect,
    ToneEffect,
    WaveformEffect,
)
from rsenf.model.effects.catalogue import CATALOGUE, load_effects, make_effect, register
from rsenf.model.effects.search import Hiding, Weakest

__all__ = [
    "CATALOGUE",
    "CodecEffect",
    "DeliveryEffect",
    "Effect",
    "FrameEffect",
    "Hiding",
    "LightEffect",
    "ReadOutEffect",
    "Run",
    "SceneEffect",
    "SensorEffect",
    "ToneEffect",
    "WaveformEffect",
    "Weakest",
    "load_effects",
    "make_effect",
    "register",
]
