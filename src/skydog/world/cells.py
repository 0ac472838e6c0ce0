"""The pushes between sheep by cells, compiled by numba. Needs: pip install 'skydog[fast]'."""

import inspect
import math

import numba
import numpy as np

SPARSE = 4  # at most so many cells a sheep: a few far strays must not cost a vast empty grid


def _pushes(sheep, radius):
    """For each of `sheep` (float32, N by 2) the sum of unit vectors away from those near it.

    Near a sheep are those within its own `radius` (float32, N). The sheep are sorted into square
    cells at least as wide as the greatest radius, so that they lie in its own cell and the eight
    around it. Every neighbour is looked at, however many share a cell. The same for any number of
    threads.
    """
    count = len(sheep)
    low_x, low_y = sheep[:, 0].min(), sheep[:, 1].min()
    wide, high = sheep[:, 0].max() - low_x, sheep[:, 1].max() - low_y
    # Wide enough too that the grid has no more cells than SPARSE a sheep in each direction.
    width = max(math.sqrt(wide * high / (SPARSE * count)), (wide + high) / (SPARSE * count))
    width = max(radius.max(), width)
    width = max(width, np.float32(1e-30))
    columns, rows = int(wide / width) + 1, int(high / width) + 1

    cell = np.empty(count, np.int64)
    first = np.zeros(columns * rows + 1, np.int64)
    for i in range(count):
        # Clamped, so that no number, were it not finite even, leads out of the grid.
        column = min(max(int((sheep[i, 0] - low_x) / width), 0), columns - 1)
        row = min(max(int((sheep[i, 1] - low_y) / width), 0), rows - 1)
        cell[i] = row * columns + column
        first[cell[i] + 1] += 1
    for c in range(columns * rows):
        first[c + 1] += first[c]
    place = first[:-1].copy()
    order = np.empty(count, np.int64)
    for i in range(count):
        order[place[cell[i]]] = i
        place[cell[i]] += 1
    x, y = sheep[order, 0], sheep[order, 1]

    pushed = np.zeros((count, 2), np.float32)
    for k in numba.prange(count):
        i = order[k]
        reach = radius[i]
        row, column = divmod(cell[i], columns)
        left, right = max(column - 1, 0), min(column + 1, columns - 1)
        push_x = push_y = np.float32(0.0)
        for beside in range(max(row - 1, 0), min(row + 1, rows - 1) + 1):
            # Cells beside each other in a row are neighbours in memory.
            for j in range(first[beside * columns + left], first[beside * columns + right + 1]):
                away_x, away_y = x[k] - x[j], y[k] - y[j]
                apart = np.sqrt(away_x * away_x + away_y * away_y)
                if np.float32(0.0) < apart <= reach:
                    push_x += away_x / apart
                    push_y += away_y / apart
        pushed[i, 0], pushed[i, 1] = push_x, push_y
    return pushed


# Unwrapped: what checks shapes while tests run is nothing that numba could compile.
pushes = numba.njit(parallel=True, cache=True)(inspect.unwrap(_pushes))
