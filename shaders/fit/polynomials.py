#!/usr/bin/env python3
"""Checks the fitted polynomials of the shaders against the functions they stand for.

Each polynomial has a line in the comment above its GLSL function:

    fit: t in [0, 1], degree 7, error 2.8e-07, best 2.8e-07

This script evaluates the polynomial as the shader's text has it, with its coefficients as float32 but in
float64 arithmetic, and finds its largest error over the interval. Then it fits a polynomial of the same
degree with the Remez exchange algorithm. That one has the smallest largest error that real coefficients can
reach ("best"), so the two together say how much a better fit could gain. The script prints both and exits
with 1 if a stated interval, degree or error does not match.

Errors are absolute, in the unit of the function: EV for log2, 8-bit codes for sRGB, radians for the arctangent.
The error of exp2 is absolute over [1, 2], so it bounds the relative error.
"""
import math
import pathlib
import re
import struct
import sys

SHADERS = pathlib.Path(__file__).resolve().parent.parent
SRGB_OF_HOST = "../server/render/host/resolve.cc"
ACES2_OF_HOST = "../server/render/host/resolve.cc"
ACES2_GAMMA = 0.59 * (1.48 + math.sqrt(0.2))
KNEE = 0.0031308  # sRGB is linear below it
OCTAVE_CODES = 255 * 1.055 * 0.5 ** (1 / 2.4)  # what the host's power is multiplied by in the octave below 1


def srgb_codes(x):
    return 255 * (1.055 * x ** (1 / 2.4) - 0.055)


def angle_over_tangent(s):
    return math.atan(math.sqrt(s)) / math.sqrt(s) if s > 0 else 1.0


def log2_over(z):
    return math.log1p(z) / z / math.log(2) if abs(z) > 1e-12 else 1 / math.log(2)


# File, function, argument, sum that the statements build up, the true function, the interval, and the unit of
# the error as a multiple of the polynomial's value.
POLYNOMIALS = [
    ("ingest.comp", "uint fixed_log2", "t", "q", lambda t: math.log2(1 + t), (0, 1), 1),
    ("glsl/environment.glsl", "float turns_of_tangent", "s", "q", angle_over_tangent, (0, 1), 2 * math.pi),
    ("glsl/log2.glsl", "float exact_log2", "t", "q", lambda t: math.log2(1 + t), (0, 1), 1),
    ("glsl/log2.glsl", "float exact_exp2", "f", "r", lambda f: 2**f, (0, 1), 1),
    ("glsl/transfer.glsl", "vec3 srgb_6", "s", "high", lambda s: srgb_codes(s**2), (KNEE ** (1 / 2), 1), 255),
    ("glsl/transfer.glsl", "vec3 srgb", "s", "high", lambda s: srgb_codes(s**4), (KNEE ** (1 / 4), 1), 255),
    ("glsl/hdr.glsl", "float log2_over", "z", "q", log2_over, (-0.1640625, 0), 1),
    (SRGB_OF_HOST, "HWY_INLINE F mantissa_power", "m", "q", lambda m: OCTAVE_CODES * m ** (1 / 2.4), (1, 2), OCTAVE_CODES),
    (ACES2_OF_HOST, "HWY_INLINE F cone_mantissa", "m", "q", lambda m: m**0.42, (1, 2), 1),
    (ACES2_OF_HOST, "HWY_INLINE F cone_root_mantissa", "m", "q", lambda m: m ** (1 / 0.42), (1, 2), 1),
    (ACES2_OF_HOST, "HWY_INLINE F lightness_mantissa", "m", "q", lambda m: m**ACES2_GAMMA, (1, 2), 1),
    (ACES2_OF_HOST, "HWY_INLINE F achromatic_mantissa", "m", "q", lambda m: m ** (1 / ACES2_GAMMA), (1, 2), 1),
]


# AgX's base curve with its power, in pieces: file, table, and how the argument is divided into them.
AGX_OF_HOST, AGX_TABLE = "../server/render/host/resolve.cc", "kAgxPieces"
AGX_PIVOT, AGX_PIECES_TO_1, AGX_FIRST = 10 / 16.5, 15, 10


def agx_light(x):
    scale = 0.54146416 if x > AGX_PIVOT else -0.51227738
    power = 3.25 if x > AGX_PIVOT else 3
    t = max(0, 2 * (x - AGX_PIVOT) / scale)
    return max(0, 0.5 + scale * t / (1 + t**power) ** (1 / power)) ** 2.2


def float32(value):
    return struct.unpack("f", struct.pack("f", value))[0]


def from_shader(file, function, argument, total):
    """The polynomial as a function, its degree, and the comment above it."""
    text = (SHADERS / file).read_text()
    begin = text.index(function + "(")
    body = text[begin : text.index("\n}", begin)]
    comment = " ".join(re.search(r"((?://[^\n]*\n)+)$", text[:begin])[1].replace("//", "").split())
    number = r"(?<![\w.])\d+\.\d+(?:e[-+]?\d+)?"
    steps = [re.sub(number, lambda literal: repr(float32(float(literal[0]))), step)
             for step in re.findall(rf"\b{total} = ([^;]*);", body)]
    code = [compile(step, function, "eval") for step in steps]

    def polynomial(x):
        names = {argument: x}
        for step in code:
            names[total] = eval(step, {}, names)
        return names[total]

    return polynomial, len(steps), comment


def chebyshev_points(interval, count):
    middle, half = (interval[0] + interval[1]) / 2, (interval[1] - interval[0]) / 2
    return [middle - half * math.cos(math.pi * i / (count - 1)) for i in range(count)]


def solve(rows):
    """Gauss-Jordan elimination with pivots; the last entry of a row is its right-hand side."""
    for column in range(len(rows)):
        pivot = max(range(column, len(rows)), key=lambda row: abs(rows[row][column]))
        rows[column], rows[pivot] = rows[pivot], rows[column]
        for row in range(len(rows)):
            if row != column:
                factor = rows[row][column] / rows[column][column]
                rows[row] = [a - factor * b for a, b in zip(rows[row], rows[column])]
    return [row[-1] / row[i] for i, row in enumerate(rows)]


def best_error(truth, interval, degree):
    """The error of the minimax polynomial: Remez exchange in the Chebyshev basis."""
    def basis(x):
        u = (2 * x - interval[0] - interval[1]) / (interval[1] - interval[0])
        terms = [1.0, u]
        while len(terms) <= degree:
            terms.append(2 * u * terms[-1] - terms[-2])
        return terms

    grid = chebyshev_points(interval, 4001)
    table = [(basis(x), truth(x)) for x in grid]
    points = chebyshev_points(interval, degree + 2)
    for _ in range(20):
        *weights, level = solve([basis(x) + [(-1) ** i, truth(x)] for i, x in enumerate(points)])
        errors = [sum(w * b for w, b in zip(weights, row)) - true for row, true in table]
        extremes = [0]
        for i, error in enumerate(errors):
            if (error > 0) != (errors[extremes[-1]] > 0):
                extremes.append(i)
            elif abs(error) > abs(errors[extremes[-1]]):
                extremes[-1] = i
        # The largest error bounds the best one from above, and the level at the points from below.
        if max(map(abs, errors)) <= 1.001 * abs(level):
            return abs(level)
        while len(extremes) > degree + 2:
            extremes.pop(0 if abs(errors[extremes[0]]) < abs(errors[extremes[-1]]) else -1)
        points = [grid[i] for i in extremes]
    raise ArithmeticError("the exchange did not settle")


def is_stated(name, line, comment):
    """Prints the line. Whether the comment has it."""
    stated = line in comment
    print(f"{name}: {line}{'' if stated else ', but the comment there says otherwise'}")
    return stated


def check_pieces():
    """Whether the comment above AgX's table is right."""
    text = (SHADERS / AGX_OF_HOST).read_text()
    begin = text.index(AGX_TABLE + "[")
    rows = re.findall(r"\{\{([^}]*)\}\}", text[begin : text.index(";", begin)])
    pieces = list(zip(*[[float32(float(number.strip().rstrip("f"))) for number in row.split(",")] for row in rows]))
    worst = best = 0
    for j, coefficients in enumerate(pieces):
        def x_of(v):
            return (v + 0.5 + j - AGX_FIRST) / AGX_PIECES_TO_1 + AGX_PIVOT
        ends = [(x - AGX_PIVOT) * AGX_PIECES_TO_1 + AGX_FIRST - j - 0.5 for x in (max(0, x_of(-0.5)), min(1, x_of(0.5)))]
        for v in chebyshev_points(ends, 4001):
            worst = max(worst, abs(sum(c * v**k for k, c in enumerate(coefficients)) - agx_light(x_of(v))))
        if j > 0:  # the first one is next to 0, and its error far below the others'
            best = max(best, best_error(lambda v: agx_light(x_of(v)), ends, len(rows) - 1))
    line = f"fit: {len(pieces)} pieces, degree {len(rows) - 1}, error {worst:.1e}, best {best:.1e}"
    return is_stated(f"{AGX_OF_HOST}: {AGX_TABLE}", line, text)


def main():
    failures = 0
    for file, function, argument, total, truth, interval, unit in POLYNOMIALS:
        polynomial, degree, comment = from_shader(file, function, argument, total)
        worst = max(abs(unit * polynomial(x) - truth(x)) for x in chebyshev_points(interval, 4001))
        best = best_error(truth, interval, degree)
        line = (f"fit: {argument} in [{interval[0]:.6g}, {interval[1]:.6g}], degree {degree}, error {worst:.1e}, "
                f"best {best:.1e}")
        failures += not is_stated(f"{file}: {function.split()[-1]}", line, comment)
    failures += not check_pieces()
    return failures > 0


if __name__ == "__main__":
    sys.exit(main())
