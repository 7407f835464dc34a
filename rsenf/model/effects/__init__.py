"""The catalogue of effects: one file each, with what it does, its source and its look-alikes."""

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
from rsenf.model.effects.hiding import Hiding, Weakest

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
