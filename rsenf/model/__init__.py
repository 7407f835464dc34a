"""The capture model: light × scene × shutter × sensor × codec, simulated with its truth.

One idea a file, in the order that light takes::

    grid, synthetic      the grid's frequency path and its phase; a path from a seed
    lamp, light          waveforms of lamps, and their average over each row's exposure
    scene, moving        the still wall, and a box that sweeps over it
    shutter, delivery    when each row is exposed; which frames arrive, and their stamps
    sensor, noise        shot and read noise, eight bits
    codec                what the encoder is told
    capture_model        all of it as one description
    exposures            all of it as numbers, block by block

From there two depths leave: ``row_level`` (row means, no pixels) and ``full_video`` (luma frames,
which ``video_file`` encodes). Both read the same exposures, so they agree within noise.
A parameter is added to the part that it belongs to; an effect acts at one of these places.
"""

from rsenf.model.capture_model import CaptureModel
from rsenf.model.codec import Codec
from rsenf.model.delivery import Delivery
from rsenf.model.frame_rate import parse_frame_rate
from rsenf.model.full_video import FrameStream, render_frames
from rsenf.model.grid import GridPath
from rsenf.model.light import Light
from rsenf.model.moving import MovingBox
from rsenf.model.parameters import ParameterError
from rsenf.model.row_level import RowData, simulate_rows
from rsenf.model.scene import Scene
from rsenf.model.sensor import Sensor
from rsenf.model.shutter import Shutter
from rsenf.model.synthetic import synthetic_grid
from rsenf.model.video_file import write_video

__all__ = [
    "CaptureModel",
    "Codec",
    "Delivery",
    "FrameStream",
    "GridPath",
    "Light",
    "MovingBox",
    "ParameterError",
    "RowData",
    "Scene",
    "Sensor",
    "Shutter",
    "parse_frame_rate",
    "render_frames",
    "simulate_rows",
    "synthetic_grid",
    "write_video",
]
