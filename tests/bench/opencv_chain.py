#!/usr/bin/env python3
"""Candela's chain written with OpenCV: bloom, exposure by the log average, a tone curve, 8 bits.

opencv_chain.py FRAME.exr FRAMES
Prints what a frame takes from halves in memory to 8 bits in memory, medians: milliseconds, and those of the processors.
"""
import math
import os
import statistics
import sys
import time

os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
import cv2  # noqa: E402  (reads the environment)
import numpy  # noqa: E402

KEY, THRESHOLD, INTENSITY, LEVELS = 0.18, 1.0, 0.05, 5


def bloom(rgb: numpy.ndarray) -> numpy.ndarray:
    """The light above the threshold, from half the frame's size on down and back up, at the frame's size."""
    height, width = rgb.shape[:2]
    half = cv2.resize(rgb, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
    levels = [cv2.max(cv2.subtract(half, (THRESHOLD,) * 4), 0)]
    for _ in range(LEVELS - 1):
        levels.append(cv2.pyrDown(levels[-1]))
    light = levels.pop()
    while levels:
        level = levels.pop()
        light = cv2.add(level, cv2.pyrUp(light, dstsize=level.shape[1::-1]))
    return cv2.resize(light, (width, height), interpolation=cv2.INTER_LINEAR)


def aces_narkowicz(x: numpy.ndarray) -> numpy.ndarray:
    above = cv2.multiply(x, cv2.add(cv2.multiply(x, (2.51,) * 4), (0.03,) * 4))
    below = cv2.add(cv2.multiply(x, cv2.add(cv2.multiply(x, (2.43,) * 4), (0.59,) * 4)), (0.14,) * 4)
    return cv2.divide(above, below)


def render(halves: numpy.ndarray) -> numpy.ndarray:
    rgb = cv2.max(cv2.convertFp16(halves), 0)
    luminance = cv2.transform(rgb, numpy.array([[0.2126, 0.7152, 0.0722]], numpy.float32))
    average = math.exp(cv2.mean(cv2.log(cv2.max(luminance, 1e-4)))[0])
    exposure = KEY / average
    light = cv2.addWeighted(rgb, exposure, bloom(rgb), exposure * INTENSITY, 0)
    display = cv2.min(aces_narkowicz(light), 1)
    return cv2.convertScaleAbs(cv2.pow(display, 1 / 2.2), alpha=255)


def main() -> None:
    path, frames = sys.argv[1], int(sys.argv[2])
    rgb = cv2.cvtColor(cv2.imread(path, cv2.IMREAD_UNCHANGED), cv2.COLOR_BGR2RGB)
    halves = rgb.astype(numpy.float16).view(numpy.int16)
    times, cpu_times = [], []
    for _ in range(frames + 2):
        start, cpu = time.perf_counter(), time.process_time()
        picture = render(halves)
        times.append(1e3 * (time.perf_counter() - start))
        cpu_times.append(1e3 * (time.process_time() - cpu))
    if picture.dtype != numpy.uint8 or not 20 < picture.mean() < 235:
        raise SystemExit(f"this is no picture: mean {picture.mean()}")
    print(statistics.median(times[2:]), statistics.median(cpu_times[2:]))


if __name__ == "__main__":
    main()
