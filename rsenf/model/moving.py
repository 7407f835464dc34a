"""Something that moves: a textured box that sweeps from side to side."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.model.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class MovingBox:
    """A box in the lamp's light; where it is, the wall isn't seen."""

    width_ratio: float = parameter(0.2, "width over the frame's width", low=0.01, high=0.9)
    height_ratio: float = parameter(0.3, "height over the frame's height", low=0.01, high=1)
    top_ratio: float = parameter(0.35, "upper edge over the frame's height", low=0, high=0.99)
    period_s: float = parameter(6.0, "time to the other side and back", low=0.1, high=3600)
    level_ratio: float = parameter(0.6, "mean level over the wall's", low=0, high=2)
    texture_ratio: float = parameter(0.25, "standard deviation of its texture", low=0, high=0.5)

    def size_px(self, rows: int, columns: int) -> tuple[int, int]:
        """Height and width in pixels; what hangs out at the bottom is cut off."""
        top = self.top_px(rows)
        height = min(max(round(self.height_ratio * rows), 1), rows - top)
        return height, max(round(self.width_ratio * columns), 1)

    def top_px(self, rows: int) -> int:
        """First row that the box covers."""
        return min(round(self.top_ratio * rows), rows - 1)

    def left_px(self, t_s: float, columns: int) -> int:
        """First column that the box covers: a triangle wave over the frame's width."""
        width = max(round(self.width_ratio * columns), 1)
        there_and_back = 2 * ((t_s / self.period_s) % 1.0)
        return round((columns - width) * min(there_and_back, 2 - there_and_back))

    def effects(self) -> list[dict[str, object]]:
        """Name what this does."""
        area = self.width_ratio * min(self.height_ratio, 1 - self.top_ratio)
        parameters = {"area_ratio": area, "period_s": self.period_s}
        return [{"name": "moving_object", "parameters": parameters}]
