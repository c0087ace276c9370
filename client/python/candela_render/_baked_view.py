"""A view of an OpenColorIO configuration as a table that every candelad can show, baked by the PyOpenColorIO that is installed.

The lattice is that of shaders/color_table.h, and the choice of axes that of client/color/view_table.cc: docs/pipeline.md section 5.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Callable

import numpy

from . import render_pb2 as pb
from ._error import invalid
from ._wire import Array

SIZE = 65  # points a side
MAX_ROOT = 1.25
GOOD_CODES = 0.75  # an error at p99.9 with which no other kind of table is tried
LEAST_END_AP1 = 320.0
LIGHT_OF_AP1_BEYOND_END = numpy.array([0.01088918, 0.02696327, 0.00214758])
REC709_TO_AP1 = numpy.array([[0.61309740, 0.33952315, 0.04737945], [0.07019372, 0.91635388, 0.01345240],
                             [0.02061559, 0.10956977, 0.86981463]])
AP1_TO_AP0 = numpy.array([[0.6954522414, 0.1406786965, 0.1638690622], [0.0447945634, 0.8596711185, 0.0955343182],
                          [-0.0055258826, 0.0040252103, 1.0015006723]])
ACES_FROM_SCENE = numpy.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
ACES_TO_DISPLAY = numpy.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
ENDS = (1.0, 2.0, 8.0, 32.0, 128.0, 512.0, 2048.0, 8192.0)
# What configurations without the role aces_interchange call linear light of Rec.709.
REC709_NAMES = ("lin_rec709_scene", "lin_rec709_srgb", "lin_rec709", "lin_srgb", "Linear Rec.709 (sRGB)", "Linear Rec.709", "Linear BT.709",
                "Utility - Linear - sRGB", "Utility - Linear - Rec.709", "Linear sRGB", "lnf_srgb")
Show = Callable[[Array], Array]


@dataclass(frozen=True)
class _Axes:
    """The primaries of a table's axes, and where the axes end."""

    name: Any  # pb.ColorTable.AXES_*
    from_scene: Array
    to_display: Array
    knee: float = 1 / 32
    end: float = 0.0

    @property
    def octaves(self) -> float:
        return float(_octaves(numpy.array([self.end / self.knee + 1]))[0])

    def light(self, v: Array) -> Array:
        """Scene light of light in the axes' primaries."""
        scene: Array = v @ numpy.linalg.inv(self.from_scene).T
        return scene

    def within(self, light: Array) -> Array:
        """Scene light in the axes' primaries, cut to them as the server cuts it."""
        v: Array = light @ self.from_scene.T
        inside: Array = numpy.clip(v, 0, self.end)
        if self.name == pb.ColorTable.AXES_AP1:
            beyond = LIGHT_OF_AP1_BEYOND_END * numpy.maximum(v - self.end, 0)
            inside = numpy.minimum(inside + beyond.sum(-1, keepdims=True) - beyond, self.end)
        return inside

    def lattice(self) -> Array:
        """The scene light at the points, red fastest."""
        octaves = self.octaves * numpy.arange(SIZE) / (SIZE - 1)
        whole = numpy.floor(octaves)
        axis = self.knee * (numpy.exp2(whole) * (3 - numpy.sqrt(4 - 3 * (octaves - whole))) - 1)
        axis[-1] = self.end
        b, g, r = numpy.meshgrid(axis, axis, axis, indexing="ij")
        return self.light(numpy.stack([r, g, b], -1).reshape(-1, 3))


AXES = (_Axes(pb.ColorTable.AXES_ACES, ACES_FROM_SCENE, ACES_TO_DISPLAY),
        _Axes(pb.ColorTable.AXES_AP1, REC709_TO_AP1, ACES_TO_DISPLAY, knee=1 / 48),
        _Axes(pb.ColorTable.AXES_REC709, numpy.eye(3), numpy.eye(3)))


@dataclass(frozen=True)
class BakedView:
    """A view as a table. Give it as view=, to a session or to a call; curve and transfer are then not used.

    With it exposure is 1 (0 EV) and there is no bloom, unless they are given, as with --ocio of the command.

    display, view: their names in the configuration. input: the colour space in which scene light enters it.
    max_codes, p999_codes, mean_codes: how far the table is from OpenColorIO, in 1/255 of the view's range, over greys and many
        colours of 2^-12 .. 2^8, a part of them outside of Rec.709.
    """

    display: str
    view: str
    input: str
    max_codes: float
    p999_codes: float
    mean_codes: float
    table: Any  # the message that is sent


def bake_view(config: Any, display: str | None = None, view: str | None = None, *, input: str | None = None) -> BakedView:
    """Bakes a view; takes a few seconds.

    config: a file, an "ocio://" name, or a PyOpenColorIO.Config. display, view: None: the default.
    input: the configuration's name of linear light of Rec.709; None: light enters as its role aces_interchange, ACES2065-1, or as
        the colour space that is named like linear light of Rec.709.

    Raises Error for what is not there, ImportError without PyOpenColorIO.
    """
    try:
        import PyOpenColorIO as ocio
    except ImportError:
        raise ImportError("bake_view() needs PyOpenColorIO: Debian's python3-pyopencolorio, or opencolorio of PyPI") from None
    try:
        loaded = config if isinstance(config, ocio.Config) else ocio.Config.CreateFromFile(str(config))
        display = _one_of("display", list(loaded.getDisplays()), display or loaded.getDefaultDisplay())
        view = _one_of(f"view of {display!r}", list(loaded.getViews(display)), view or loaded.getDefaultView(display))
        names = (input,) if input else (ocio.ROLE_INTERCHANGE_SCENE, *REC709_NAMES)
        entry, space = next(((name, space) for name in names if (space := loaded.getColorSpace(name)) is not None), ("", None))
        if space is None:
            raise invalid(f"the configuration has no {f'colour space {input!r}' if input else 'role aces_interchange'}; give the name "
                          f"of its linear light of Rec.709 as input: {', '.join(loaded.getColorSpaceNames())}")
        shown = loaded.getDisplayViewColorSpaceName(display, view)
        target = loaded.getColorSpace(display if shown == ocio.OCIO_VIEW_USE_DISPLAY_NAME else shown)
        if target is not None and target.isData():
            raise invalid(f"view {view!r} shows data as it is; render with curve=\"linear\" and transfer=\"linear\" instead")
        transform = ocio.DisplayViewTransform(src=space.getName(), display=display, view=view)
        processor = loaded.getProcessor(transform).getOptimizedCPUProcessor(ocio.OPTIMIZATION_LOSSLESS)
    except ocio.Exception as error:
        raise invalid(f"OpenColorIO {ocio.GetVersion()}: {' '.join(str(error).split())}") from None
    matrix = AP1_TO_AP0 @ REC709_TO_AP1 if entry == ocio.ROLE_INTERCHANGE_SCENE else numpy.eye(3)

    def show(light: Array) -> Array:
        values = numpy.ascontiguousarray(light @ matrix.T, numpy.float32)
        processor.applyRGB(values)
        return values

    return bake_transform(show, display=display, view=view, input=space.getName())


def bake_transform(show: Show, *, display: str = "", view: str = "", input: str = "linear Rec.709") -> BakedView:
    """The same of any transform: `show` takes (n, 3) float32, exposed scene light of Rec.709, and gives (n, 3) display values, where
    0 .. 1 is shown and the rest is cut. Light outside of Rec.709 has negative components."""
    def checked(light: Array) -> Array:
        values = numpy.asarray(show(light.astype(numpy.float32)))
        if values.shape != light.shape:
            raise invalid(f"show gives an array of {values.shape} for one of {light.shape}")
        return values

    best: BakedView | None = None
    colors = _test_colors()
    shown = checked(colors)
    for kind in AXES:
        axes = replace(kind, end=_end(checked, kind))
        values = checked(axes.lattice()).astype(numpy.float64)
        for mirrored in (False, True):
            roots = _roots(_to_light(values, mirrored), axes)
            codes = 255 * numpy.abs(_look_up(roots, axes, colors) - _shown(shown))
            message = pb.ColorTable(size=SIZE, end=axes.end, axes=axes.name, values=roots.astype("<u2").tobytes())
            made = BakedView(display, view, input, float(codes.max()), float(numpy.quantile(codes, 0.999)), float(codes.mean()), message)
            if best is None or made.p999_codes < best.p999_codes:
                best = made
            if best.p999_codes <= GOOD_CODES:
                return best
    assert best is not None
    return best


def _one_of(what: str, names: list[str], name: str) -> str:
    if name not in names:
        raise invalid(f"there is no {what} {name!r}; there are: {', '.join(names)}")
    return name


def _shown(values: Array) -> Array:
    """NaN counts as black."""
    return numpy.clip(numpy.nan_to_num(values.astype(numpy.float64), nan=0.0), 0, 1)


def _to_light(values: Array, mirrored: bool) -> Array:
    """Display light for values, by the sRGB curve. `mirrored` says how the curve continues below 0."""
    v = numpy.abs(values) if mirrored else values
    light = numpy.where(v <= 0.04045, v / 12.92, ((numpy.maximum(v, 0.04045) + 0.055) / 1.055) ** 2.4)
    return numpy.copysign(light, values) if mirrored else light


def _octaves(x: Array) -> Array:
    """log2 made of parabolas."""
    mantissa, exponent = numpy.frexp(x)
    m = 2 * mantissa - 1
    octaves: Array = exponent - 1 + m * (4 - m) / 3
    return octaves


def _roots(light: Array, axes: _Axes) -> Array:
    """What a table stores, 0 .. 65535."""
    light = numpy.clip(numpy.nan_to_num(light, nan=-0.5), -0.5, 1.5) @ numpy.linalg.inv(axes.to_display).T
    roots: Array = numpy.floor(numpy.minimum(numpy.sqrt(numpy.maximum(light, 0)) / MAX_ROOT, 1) * 65535 + 0.5)
    return roots


def _look_up(roots: Array, axes: _Axes, light: Array) -> Array:
    """The display values that a server makes of a table, in double precision: by tetrahedral interpolation of the roots."""
    place = _octaves(axes.within(light) / axes.knee + 1) / axes.octaves * (SIZE - 1)
    cell = numpy.clip(numpy.floor(place), 0, SIZE - 2).astype(numpy.int64)
    fraction = place - cell
    steps = numpy.array([1, SIZE, SIZE * SIZE])
    at = cell @ steps
    unit = roots / 65535 * MAX_ROOT
    here = unit[at]
    root = here.copy()
    for axis in numpy.argsort(-fraction, axis=-1, kind="stable").T:
        at = at + steps[axis]
        there = unit[at]
        root += numpy.take_along_axis(fraction, axis[:, None], 1) * (there - here)
        here = there
    shown = numpy.clip(root**2 @ axes.to_display.T, 0, 1)
    return numpy.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)


def _end(show: Show, axes: _Axes) -> float:
    """The lowest end at which a cut changes 99 % of the values by at most half a code."""
    light = numpy.exp2(numpy.random.default_rng(1).uniform(-2, 16, (1000, 3)))
    shown = _shown(show(light))
    for end in ENDS:
        cut = replace(axes, end=end)
        if (255 * numpy.abs(_shown(show(cut.light(cut.within(light)))) - shown) > 0.5).mean() <= 0.01:
            return max(end, LEAST_END_AP1) if axes.name == pb.ColorTable.AXES_AP1 else end
    return 65504.0


def _test_colors() -> Array:
    """Greys, colours within an octave, any colours, and saturated ones up to the gamut of ACES AP1."""
    random = numpy.random.default_rng(2)
    greys = numpy.repeat(random.uniform(-12, 8, (2000, 1)), 3, 1)
    near = random.uniform(-11, 7, (10000, 1)) + random.uniform(-1, 1, (10000, 3))
    anything = random.uniform(-12, 8, (10000, 3))
    count = 9000
    part = random.uniform(0, 1, (count, 3))
    part[numpy.arange(count), random.integers(0, 3, count)] = numpy.where(numpy.arange(count) % 2 == 0, 0, numpy.exp2(random.uniform(-10, 0, count)))
    saturated = numpy.exp2(random.uniform(-12, 8, (count, 1))) * part @ numpy.linalg.inv(REC709_TO_AP1).T
    return numpy.concatenate([numpy.exp2(numpy.concatenate([greys, near, anything])), saturated])
