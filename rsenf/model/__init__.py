"""The capture model: simulates what a camera records under mains light, with its ground truth.

In: a :class:`CaptureModel` (light × scene × shutter × sensor × codec, and effects), a
:class:`GridPath` of the grid's frequency, and a seed. Out: row means (``row_level``) or luma frames
(``full_video``), both from the same exposures, so that they agree within noise. Read in order::

    parameters, seeds, frame_rate      declared parameters; random numbers; exact frame rates
    grid, synthetic                    frequency path and phase of the grid; a path from a seed
    lamp, light, line_light            waveforms; their mean over exposures; light on each line
    scene, view, strips, wander        wall and texture; as lines and strips; slow random series
    shutter, readout, clip             read-out order; line times; frames delivered, time stamps
    sensor, noise, codec               shot and read noise; noise of pixels; encoder settings
    effects                            all that a plain capture doesn't do, by place
    capture_model, chain, exposures    the description; its effects in a clip; block by block
    row_level, full_video, video_file  simulated rows; simulated frames; encoded files
    truth                              the ground truth

``analytic`` and the files of that name are the paper's line model. A parameter that every capture
has belongs to its part of the model; everything else is an effect.
"""

from rsenf.model.capture_model import CaptureModel
from rsenf.model.codec import Codec
from rsenf.model.effects import CATALOGUE, Effect, load_effects, make_effect
from rsenf.model.frame_rate import parse_frame_rate
from rsenf.model.full_video import FrameStream, render_frames
from rsenf.model.grid import GridPath
from rsenf.model.light import Light
from rsenf.model.parameters import ParameterError
from rsenf.model.row_level import RowData, simulate_rows
from rsenf.model.scene import Scene, Shake
from rsenf.model.sensor import Sensor
from rsenf.model.shutter import Shutter
from rsenf.model.synthetic import synthetic_grid
from rsenf.model.video_file import write_video, write_videos

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
