"""Triangles and lines painted into an image: a pixel shows what is nearest to the eye there, through what is seen through.

image (rows, columns, 3): colours, 0 ... 1; depth (rows, columns): how near what a pixel shows is. Corners are (column, row,
depth) in pixels, the centre of the first pixel is at 0.5, 0.5; nearer is more. Colours are red, green, blue, opacity.
"""

import math

import numpy as np
from numba import njit

from fenics_contact.types import Array, Floats

TIE = 1e-300  # on an edge: belongs to one of the two triangles that meet there


@njit(cache=True)
def side(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    """Twice the area of a, b and a place, below zero right of the way from a to b: of the way back the exact opposite."""
    if ax > bx or (ax == bx and ay > by):
        back = (ax - bx) * (y - by) - (ay - by) * (x - bx)
        return -back if back != 0.0 else -TIE
    forth = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    return forth if forth != 0.0 else TIE


@njit(cache=True)
def span(least: float, most: float, count: int) -> tuple[int, int]:
    """First pixel and the one behind the last whose centres may lie between two places."""
    return max(0, int(math.ceil(max(least, 0.0) - 0.5))), min(count, int(math.floor(min(most, count + 1.0) - 0.5)) + 1)


@njit(cache=True)
def paint(image: Array, depth: Array, corners: Floats, colours: Floats, seen_through: bool) -> None:
    """Triangles (n, 3, 3) in the colours (n, 3, 4) of their corners, in their order.

    What is seen through tints what lies behind it and does not hide it: the farthest comes first.
    """
    for n in range(len(corners)):
        ax, ay, az = corners[n, 0]
        bx, by, bz = corners[n, 1]
        cx, cy, cz = corners[n, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        turn = 1.0 if area > 0.0 else -1.0
        top, bottom = span(min(ay, by, cy), max(ay, by, cy), image.shape[0])
        left, right = span(min(ax, bx, cx), max(ax, bx, cx), image.shape[1])
        for row in range(top, bottom):
            for column in range(left, right):
                x, y = column + 0.5, row + 0.5
                a = turn * side(bx, by, cx, cy, x, y)
                b = turn * side(cx, cy, ax, ay, x, y)
                c = turn * side(ax, ay, bx, by, x, y)
                if a < 0.0 or b < 0.0 or c < 0.0:
                    continue
                total = a + b + c
                a, b, c = a / total, b / total, c / total
                z = a * az + b * bz + c * cz
                if z <= depth[row, column]:
                    continue
                if not seen_through:
                    depth[row, column] = z
                opacity = a * colours[n, 0, 3] + b * colours[n, 1, 3] + c * colours[n, 2, 3] if seen_through else 1.0
                for i in range(3):
                    own = a * colours[n, 0, i] + b * colours[n, 1, i] + c * colours[n, 2, i]
                    image[row, column, i] += opacity * (own - image[row, column, i])


@njit(cache=True)
def draw(image: Array, depth: Array, ends: Floats, colours: Floats, half: float) -> None:
    """Lines (n, 2, 3) in colours (n, 4), `half` pixels to either side; where they meet or cross a pixel is tinted once."""
    done = np.zeros(depth.shape, dtype=np.bool_)
    for n in range(len(ends)):
        ax, ay, az = ends[n, 0]
        bx, by, bz = ends[n, 1]
        square = max((bx - ax) ** 2 + (by - ay) ** 2, TIE)
        top, bottom = span(min(ay, by) - half, max(ay, by) + half, image.shape[0])
        left, right = span(min(ax, bx) - half, max(ax, bx) + half, image.shape[1])
        for row in range(top, bottom):
            for column in range(left, right):
                x, y = column + 0.5 - ax, row + 0.5 - ay
                s = min(1.0, max(0.0, (x * (bx - ax) + y * (by - ay)) / square))
                far = (x - s * (bx - ax)) ** 2 + (y - s * (by - ay)) ** 2 > half**2
                if far or done[row, column] or az + s * (bz - az) <= depth[row, column]:
                    continue
                done[row, column] = True
                for i in range(3):
                    image[row, column, i] += colours[n, 3] * (colours[n, i] - image[row, column, i])


@njit(cache=True)
def averaged(image: Array, across: int) -> Array:
    """Image in bytes (rows, columns, 3), each pixel the mean of `across` x `across` ones."""
    rows, columns = image.shape[0] // across, image.shape[1] // across
    mean, scale = np.empty((rows, columns, 3), dtype=np.uint8), 255.0 / across**2
    for row in range(rows):
        for column in range(columns):
            for i in range(3):
                total = 0.0
                for j in range(across * row, across * (row + 1)):
                    for k in range(across * column, across * (column + 1)):
                        total += image[j, k, i]
                mean[row, column, i] = int(scale * total + 0.5)
    return mean
