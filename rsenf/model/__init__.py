"""The capture model: light × scene × shutter × sensor × codec, simulated with its truth.

One idea a file, in the order that light takes::

    grid, synthetic      the grid's frequency path and its phase; a path from a seed
    lamp, light          waveforms of lamps, and their average over each line's exposure
    scene, view, strips  the wall, and how its lines and strips look to the shutter
    shutter, readout     in which order lines are read, and when each is exposed
    line_light           how bright the light is on each line
    clip                 which frames arrive, and their stamps
    sensor, noise        shot and read noise, eight bits
    codec                what the encoder is told
    effects              all that a plain capture doesn't do, one file each
    capture_model        all of it as one description
    chain, exposures     all of it as numbers, block by block

From there two depths leave: ``row_level`` (row means, no pixels) and ``full_video`` (luma frames,
made by ``renderer``, which ``video_file`` encodes). Both read the same exposures, so they agree
within noise. A parameter that every capture has belongs to its part; whatever else a capture can
do is an effect, and stands nowhere else.
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
