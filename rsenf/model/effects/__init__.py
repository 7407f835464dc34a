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
from rsenf.model.effects.catalogue import CATALOGUE, effect_named, load_effects, register

__all__ = [
    "CATALOGUE",
    "CodecEffect",
    "DeliveryEffect",
    "Effect",
    "FrameEffect",
    "LightEffect",
    "ReadOutEffect",
    "Run",
    "SceneEffect",
    "SensorEffect",
    "ToneEffect",
    "WaveformEffect",
    "effect_named",
    "load_effects",
    "register",
]
