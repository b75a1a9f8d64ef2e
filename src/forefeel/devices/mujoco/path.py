"""A planar vessel: straights and arcs of given half width, its centre line and the facets of its wall."""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, copysign, radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from forefeel.devices.mujoco.settings import GuidewireSettings

Array = NDArray[np.float64]

GUIDE_M = 2e-3  # inner width of the straight catheter in front of the vessel
WALL_M = 1.5e-3
_FACET_M = 1.5e-3  # a chord of that length is 14 um off an arc of 20 mm
_GRID_M, _BEHIND_M = 1e-4, 5e-3


class Piece(NamedTuple):
    """Length, curvature (1/m, positive to the left) and half of the inner width."""

    length_m: float
    curvature: float
    half_m: float


class Bar(NamedTuple):
    """A rounded bar of the wall: the two ends of its axis, and its radius."""

    x0: float
    y0: float
    x1: float
    y1: float
    radius_m: float


class Path:
    """Pieces that follow one another without a corner, from the origin along x."""

    def __init__(self, pieces: tuple[Piece, ...]) -> None:
        self.pieces = pieces
        self.length_m = sum(piece.length_m for piece in pieces)
        self._starts = [(0.0, 0.0, 0.0, 0.0)]  # arc length, x, y, heading
        for piece in pieces:
            s = self._starts[-1][0] + piece.length_m
            self._starts.append((s, *_along(self._starts[-1], piece, piece.length_m)))
        grid = np.arange(-_BEHIND_M, self.length_m, _GRID_M)  # the stage stands behind the guide
        at = np.array([self.at(s) for s in grid])
        self.line, self._half_m = at[:, :2], np.array([self._piece(s)[1].half_m for s in grid])
        self._tree = cKDTree(self.line)

    def _piece(self, s: float) -> tuple[tuple[float, float, float, float], Piece]:
        i = next((i for i in range(len(self.pieces)) if s < self._starts[i + 1][0]), len(self.pieces) - 1)
        return self._starts[i], self.pieces[i]

    def at(self, s: float) -> tuple[float, float, float]:
        """x, y and heading of the centre line at that arc length."""
        start, piece = self._piece(s)
        return _along(start, piece, s - start[0])

    def outside_m(self, points: Array, radius_m: float) -> float:
        """Reach of the farthest of some circles beyond the lumen; negative where all are within."""
        distance, nearest = self._tree.query(points)
        return float(np.max(distance + radius_m - self._half_m[nearest]))

    def walls_m(self, s: float) -> Array:
        """x and y of the left wall, then of the right one, at that arc length."""
        x, y, turn = self.at(s)
        off_x, off_y = self._piece(s)[1].half_m * np.array([-np.sin(turn), np.cos(turn)])
        return np.array([x + off_x, y + off_y, x - off_x, y - off_y])

    def crosses_itself(self) -> bool:
        """True if two distant parts of the path are nearer to each other than the widest lumen with walls."""
        line, half = self.line[::10], self._half_m[::10]
        apart = np.hypot(*(line[:, None] - line[None]).transpose(2, 0, 1))
        s = np.arange(len(line)) * 10 * _GRID_M
        near = 2.0 * (float(np.max(half)) + WALL_M)
        # an arc of the least radius, 20 mm, has gone further than that after pi / 2 of it
        return bool(np.any(apart[np.abs(s[:, None] - s[None]) > 0.5 * np.pi * near] < near))

    def bars(self) -> Iterator[Bar]:
        """Yields the bars along both sides, whose faces are the wall; a narrower piece has thicker ones."""
        widest = max(piece.half_m for piece in self.pieces)
        for (_, x0, y0, heading), piece in zip(self._starts, self.pieces, strict=False):
            count = ceil(piece.length_m / _FACET_M) if piece.curvature else 1
            radius = WALL_M + widest - piece.half_m
            start = 0.0, x0, y0, heading
            ends = [_along(start, piece, i * piece.length_m / count) for i in range(count + 1)]
            for side in (1.0, -1.0):  # left, right
                off = side * (piece.half_m + radius)
                axis = [(x - off * np.sin(turn), y + off * np.cos(turn)) for x, y, turn in ends]
                for a, b in pairwise(axis):
                    yield Bar(*a, *b, radius)


def vessel_path(settings: GuidewireSettings) -> Path:
    """The guide catheter and the pieces of the vessel behind it."""
    half_m = 0.5 * settings.lumen_m
    pieces = [Piece(settings.guide_m, 0.0, 0.5 * GUIDE_M)]
    for piece in settings.pieces:
        if piece.radius_m is None:
            assert piece.length_m is not None
            pieces.append(Piece(piece.length_m, 0.0, half_m))
        else:
            turn = radians(piece.turn_deg or 0.0)
            pieces.append(Piece(piece.radius_m * abs(turn), copysign(1.0 / piece.radius_m, turn), half_m))
    return Path(tuple(pieces))


def _along(start: tuple[float, float, float, float], piece: Piece, s: float) -> tuple[float, float, float]:
    """x, y and heading at arc length s of a piece that begins at `start`: (unused, x, y, heading)."""
    _, x, y, heading = start
    k = piece.curvature
    if not k:
        return x + s * np.cos(heading), y + s * np.sin(heading), heading
    end = heading + k * s
    return x + (np.sin(end) - np.sin(heading)) / k, y - (np.cos(end) - np.cos(heading)) / k, end
