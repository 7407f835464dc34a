"""The capture model: simulates what a camera records under mains light, with its ground truth.

In: a :class:`CaptureModel` (light × scene × shutter × sensor × codec, and effects), a
:class:`GridPath` of the grid's frequency, and a seed. Out: row means (``row_level``) or luma frames
(``full_video``), both from the same exposures, so that they agree within noise. Read in order::

    parameters                     declared parameters; frame rates as exact fractions
    noise                          random numbers, slow random series, noise of pixels, of a sensor
    grid                           frequency path and phase of the grid, also from a seed
    light, line_light              waveforms and their mean over exposures; light on each line
    shutter                        read-out order; frames delivered, time stamps; line times
    scene                          wall and texture, as lines and strips
    effects                        all that a plain capture doesn't do, by place
    capture_model, exposures       the description; its effects in a clip, block by block
    row_level                      simulated rows; the ground truth
    full_video, video_file         simulated frames; encoder settings, encoded files

``analytic`` and the files of that name are the paper's line model. A parameter that every capture
has belongs to its part of the model; everything else is an effect.
"""

from rsenf.model.capture_model import CaptureModel
from rsenf.model.effects import CATALOGUE, Effect, load_effects, make_effect
from rsenf.model.full_video import FrameStream, render_frames
from rsenf.model.grid import GridPath, synthetic_grid
from rsenf.model.light import Light
from rsenf.model.noise import Sensor
from rsenf.model.parameters import ParameterError, parse_frame_rate
from rsenf.model.row_level import RowData, simulate_rows
from rsenf.model.scene import Scene, Shake
from rsenf.model.shutter import Shutter
from rsenf.model.video_file import Codec, write_video, write_videos

__all__ = [
    "CATALOGUE",
    "CaptureModel",
    "Codec",
    "Effect",
    "FrameStream",
    "GridPath",
    "Light",
    "ParameterError",
    "RowData",
    "Scene",
    "Sensor",
    "Shake",
    "Shutter",
    "load_effects",
    "make_effect",
    "parse_frame_rate",
    "render_frames",
    "simulate_rows",
    "synthetic_grid",
    "write_video",
    "write_videos",
]
