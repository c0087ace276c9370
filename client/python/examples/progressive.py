"""A progressive renderer: each pass adds samples, and the picture so far is shown at the exposure of the first good one.

progressive.py PICTURE.png [PASSES]
"""
import sys

import candela_render as candela
import numpy


def sample(chance: numpy.random.Generator, height: int = 180, width: int = 320) -> numpy.ndarray:
    """One noisy sample a pixel of a sphere in the sun. A path tracer's buffer does as well."""
    jitter = chance.random((2, height, width), dtype=numpy.float32)
    y, x = (numpy.mgrid[0:height, 0:width] + jitter - [[[height / 2]], [[width / 2]]]) / (height / 2)
    depth = numpy.sqrt(numpy.maximum(0, 0.64 - x * x - y * y))
    sun = numpy.maximum(0, 0.5 * x - 0.6 * y + 0.62 * depth) * chance.exponential(1, (height, width))
    light = numpy.where(depth > 0, 6 * sun, 0.4 + 0.2 * y)
    return numpy.stack([light, 0.9 * light, 0.7 * light], axis=-1).astype(numpy.float32)


def main(picture: str, passes: int = 16) -> None:
    chance = numpy.random.default_rng(1)
    total, exposure = numpy.zeros((180, 320, 3), numpy.float32), None
    with candela.Session(encoding="png", curve="aces-hill") as session:
        for n in range(1, passes + 1):
            total += sample(chance)
            # A viewer must not flicker while noise goes away: after four passes the exposure stays.
            png, info = session(total / n, time=n, cut=True, exposure=exposure)
            exposure = info.exposure if n >= 4 else None
            with open(picture, "wb") as file:  # a file that a viewer shows again
                file.write(png)
            print(f"pass {n}: {numpy.log2(info.exposure):+.2f} EV")


main(sys.argv[1], *map(int, sys.argv[2:]))
