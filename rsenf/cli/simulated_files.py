"""A simulated clip as files: videos, arrays or a recording, and the truth beside them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli.console import progress_bar

if TYPE_CHECKING:
    from rsenf.model import CaptureModel, Codec, GridPath, RowData


@dataclass(frozen=True)
class SimulatedClip:
    """What is filmed, and the name of its file."""

    out: Path
    model: CaptureModel
    grid: GridPath
    duration_s: float
    seed: int

    @property
    def truth_path(self) -> Path:
        """Where its truth stands."""
        return self.out.with_suffix(".truth.json")

    def write_videos(self, codecs: dict[str, Codec]) -> dict[str, Any]:
        """Render once, encode all; files are called X.mp4, or X.<label>.mp4 where it has a label.

        Returns
        -------
        dict
            The truth, also of which file is encoded how.
        """
        from rsenf.model import render_frames, write_videos

        frames = render_frames(self.model, self.grid, self.duration_s, self.seed)
        paths = {self._labelled(label): codec for label, codec in codecs.items()}
        told = [(path.name, codec.to_dict()) for path, codec in paths.items()]
        rate_hz = float(frames.frame_rate)
        with self._truth_beside(frames.truth, told) as truth, self._progress(rate_hz) as show:
            write_videos(paths, frames, show)
        return truth

    def write_arrays(self, strips: int) -> dict[str, Any]:
        """Write row means as ``.npz``; returns the truth."""
        import numpy as np

        from rsenf.whole_file import whole_file

        data = self._rows(strips)
        with (
            self._truth_beside(data.truth, [(self.out.name, None)]) as truth,
            whole_file(self.out) as part,
            part.open("wb") as file,
        ):
            np.savez(file, rows=data.level, frame_time_s=data.frame_time_s)
        return truth

    def write_recording(self, strips: int, site: str, camera: str) -> dict[str, Any]:
        """Write row means as the row blocks of a camera in an MCAP file; returns the truth."""
        from rsenf.bus.keys import camera_key, is_name
        from rsenf.errors import UsageError
        from rsenf.messages import Header
        from rsenf.record import Recorder
        from rsenf.rows.luminance import blocks_from_luminance

        for name in (site, camera):
            if not is_name(name):
                raise UsageError(f"{name!r} can't be a part of a topic", "use letters and digits")
        data = self._rows(strips)
        header = Header(source=f"{site}/{camera}")
        info = {"run_id": f"simulated-{self.seed}", "site": site, "source": "rsenf simulate"}
        blocks = blocks_from_luminance(
            data.level, data.frame_time_s, header, read_out_axis=data.truth["read_out_axis"]
        )
        with (
            self._truth_beside(data.truth, [(self.out.name, None)]) as truth,
            Recorder(self.out, run_info=info, clock_ns=time.time_ns, overwrite=True) as recorder,
        ):
            for block in blocks:
                recorder.write(camera_key(site, camera, "rows"), block)
        return truth

    def _rows(self, strips: int) -> RowData:
        from rsenf.model import simulate_rows

        rate_hz = float(self.model.shutter.frame_rate)
        with self._progress(rate_hz) as show:
            return simulate_rows(
                self.model, self.grid, self.duration_s, self.seed, strips=strips, progress=show
            )

    def _labelled(self, label: str) -> Path:
        return self.out.with_suffix(f".{label}{self.out.suffix}") if label else self.out

    @contextmanager
    def _progress(self, rate_hz: float) -> Iterator[Callable[[int], None]]:
        with progress_bar("filming", self.duration_s) as show:
            yield lambda frames: show(frames / rate_hz)

    @contextmanager
    def _truth_beside(
        self, truth: dict[str, Any], files: Sequence[tuple[str, dict[str, Any] | None]]
    ) -> Iterator[dict[str, Any]]:
        """Let the truth appear when the clip has."""
        from rsenf.whole_file import whole_file

        told = truth | {"files": [{"name": name, "codec": codec} for name, codec in files]}
        with whole_file(self.truth_path) as part:
            part.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
            yield told
