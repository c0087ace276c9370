"""Views that are baked in Python, against what they stand for."""
import json
import os
import pathlib
import subprocess
import sys
import unittest
import unittest.mock

import candela_render as candela
import numpy
from support import BIN, Test

try:
    import PyOpenColorIO as ocio
except ImportError:
    ocio = None

CONFIG = """ocio_profile_version: 2
roles: {default: ACES2065-1, aces_interchange: ACES2065-1, cie_xyz_d65_interchange: CIE-XYZ-D65}
file_rules:
  - !<Rule> {name: Default, colorspace: default}
displays:
  sRGB:
    - !<View> {name: ACES, view_transform: ACES, display_colorspace: sRGB - Display}
    - !<View> {name: Plain, view_transform: Plain, display_colorspace: sRGB - Display}
view_transforms:
  - !<ViewTransform>
    name: Plain
    from_scene_reference: !<BuiltinTransform> {style: UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD}
  - !<ViewTransform>
    name: ACES
    from_scene_reference: !<BuiltinTransform> {style: ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO_1.0}
display_colorspaces:
  - !<ColorSpace>
    name: CIE-XYZ-D65
  - !<ColorSpace>
    name: sRGB - Display
    from_display_reference: !<BuiltinTransform> {style: DISPLAY - CIE-XYZ-D65_to_sRGB}
colorspaces:
  - !<ColorSpace>
    name: ACES2065-1
"""
needs_ocio = unittest.skipIf(ocio is None, "there is no PyOpenColorIO; Debian has it as python3-pyopencolorio")
data = pathlib.Path(os.environ.get("CANDELA_DATA") or "no such folder") / "aces2/config_views.json"
needs_data = unittest.skipUnless(data.exists(), "no test data; set CANDELA_DATA")


def srgb(light):
    return numpy.where(light <= 0.0031308, 12.92 * light, 1.055 * numpy.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def colors(count=4000):
    """Each for itself in a row of a frame, from 2^-10 to 2^6."""
    return numpy.exp2(numpy.random.default_rng(7).uniform(-10, 6, (count, 3))).astype(numpy.float32)


def rendered(light, **settings):
    """Display values of colours, 0 .. 1."""
    image, info = candela.render(light.astype(numpy.float32)[None], output_format="rgba16", **settings)
    return image[0, :, :3] / 65535, info


class BakedViews(Test):
    def test_a_transform_is_shown_within_its_error(self):
        def show(light):
            return srgb(numpy.maximum(light, 0) / (numpy.maximum(light, 0) + 0.5))

        baked = candela.bake_transform(show, view="mine")
        light = colors()
        seen, info = rendered(light, view=baked)
        self.assertEqual(info.exposure, 1)
        off = 255 * numpy.abs(seen - show(light))
        self.assertLess(off.max(), baked.max_codes + 0.1)
        self.assertLess(abs(off.mean() - baked.mean_codes), 0.1)
        self.assertGreater(255 * numpy.abs(seen - srgb(numpy.minimum(light, 1))).max(), 20)  # not another curve's

    def test_a_session_shows_it_and_can_expose(self):
        baked = candela.bake_transform(lambda light: srgb(numpy.clip(light, 0, 1)))
        frame = numpy.full((8, 8, 3), 0.25, numpy.float32)

        def code(light):
            return round(255 * float(srgb(numpy.float64(light))))

        with candela.Session(view=baked) as session:
            self.assertEqual(session(frame, time=0)[0][0, 0, 0], code(0.25))
            image, info = session(frame, time=1, exposure=2.0)
        self.assertEqual((info.exposure, image[0, 0, 0]), (2, code(0.5)))
        image, info = candela.render(frame, view=baked, settings=candela.Settings(exposure={"mode": "manual", "manual_ev": 1}))
        self.assertEqual((info.exposure, image[0, 0, 0]), (2, code(0.5)))

    def test_wrong_ones_are_refused(self):
        frame = numpy.ones((2, 2, 3), numpy.float32)
        with self.fails("INVALID_ARGUMENT", "it is a BakedView"):
            candela.render(frame, view="ACES")
        with self.fails("INVALID_ARGUMENT", "show gives an array of"):
            candela.bake_transform(lambda light: light[:, 0])
        baked = candela.bake_transform(lambda light: light)
        with self.fails("INVALID_ARGUMENT", "view is in place of curve"):
            candela.render(frame, view=baked, curve="agx")

    def test_without_opencolorio_it_says_so(self):
        with unittest.mock.patch.dict(sys.modules, {"PyOpenColorIO": None}), self.assertRaisesRegex(ImportError, "python3-pyopencolorio"):
            candela.bake_view("studio.ocio")

    @needs_data
    def test_the_published_view_of_aces_2(self):
        """The server's own aces-2, which other tests hold to OpenColorIO, is the transform."""
        def show(light):
            return numpy.concatenate([rendered(part, curve="aces-2", exposure=1.0, bloom={"intensity": 0})[0]
                                      for part in numpy.array_split(light, max(1, len(light) // 8192))])

        baked = candela.bake_transform(show)
        published = json.loads(data.read_text())
        view = next(view for view in published["views"]
                    if view["colorspace"] == "Linear Rec.709 (sRGB)" and view["display"] == "sRGB - Display")
        light = numpy.array(published["inputs"], numpy.float32)
        seen = rendered(light, view=baked)[0]
        codes = 255 * numpy.abs(seen - numpy.clip(view["rgb"], 0, 1))
        print(f"ACES 2.0 by a table: at most {codes.max():.2f} codes, {codes.mean():.3f} on average; said: {baked.max_codes:.2f}")
        self.assertLessEqual(codes.max(), baked.max_codes + 0.5)

    @needs_data
    @unittest.skipUnless(ocio and tuple(map(int, ocio.GetVersion().split(".")[:2])) >= (2, 5), "there is no PyOpenColorIO 2.5")
    def test_the_newest_configurations_view(self):
        published = json.loads(data.read_text())
        for view in published["views"]:
            if view["colorspace"] != "Linear Rec.709 (sRGB)":
                continue
            baked = candela.bake_view(f"ocio://{published['config']}", view["display"], view["view"])
            seen = rendered(numpy.array(published["inputs"], numpy.float32), view=baked)[0]
            self.assertLessEqual(255 * numpy.abs(seen - numpy.clip(view["rgb"], 0, 1)).max(), baked.max_codes + 0.5)

    @needs_ocio
    def test_a_configurations_view_is_the_commands(self):
        studio = pathlib.Path(self.folder) / "studio.ocio"
        studio.write_text(CONFIG)
        light = colors()
        pfm = pathlib.Path(self.folder) / "in.pfm"
        pfm.write_bytes(b"PF\n%d 1\n-1.0\n" % len(light) + light.astype("<f4").tobytes())
        for view, near in (("ACES", 1.0), ("Plain", 2.0)):
            baked = candela.bake_view(studio, view=view)
            self.assertEqual((baked.display, baked.view, baked.input), ("sRGB", view, "ACES2065-1"))
            self.assertLess(baked.p999_codes, near)
            seen = rendered(light, view=baked)[0]
            out = pathlib.Path(self.folder) / "out.pfm"
            subprocess.run([BIN / "candela", "render", pfm, out, "--ocio", studio, "--ocio-view", view, "-q"], check=True)
            command = numpy.frombuffer(out.read_bytes()[-12 * len(light):], "<f4").reshape(-1, 3)
            self.assertLess(255 * numpy.abs(seen - command).max(), baked.max_codes + 1)
            self.assertLess(255 * numpy.abs(seen - command).mean(), 0.1)
        self.assertEqual(candela.bake_view(ocio.Config.CreateFromFile(str(studio))).view, "ACES")

    @needs_ocio
    def test_light_enters_as_linear_rec709_without_the_role(self):
        old = pathlib.Path(self.folder) / "old.ocio"
        old.write_text("""ocio_profile_version: 2
roles: {default: Linear sRGB}
displays:
  sRGB:
    - !<View> {name: Doubled, colorspace: doubled}
    - !<View> {name: Raw, colorspace: raw}
colorspaces:
  - !<ColorSpace>
    name: Linear sRGB
  - !<ColorSpace>
    name: raw
    isdata: true
  - !<ColorSpace>
    name: doubled
    from_scene_reference: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}
""")
        baked = candela.bake_view(old)
        self.assertEqual(baked.input, "Linear sRGB")
        light = numpy.array([[0.25, 0.1, 0.4]], numpy.float32)
        numpy.testing.assert_allclose(rendered(light, view=baked)[0], 2 * light, atol=0.01)
        self.assertEqual(candela.bake_view(old, input="Linear sRGB").table, baked.table)
        with self.fails("INVALID_ARGUMENT", "view 'Raw' shows data as it is"):
            candela.bake_view(old, view="Raw")

    @needs_ocio
    def test_what_is_not_there_is_named_beside_what_is(self):
        studio = pathlib.Path(self.folder) / "studio.ocio"
        studio.write_text(CONFIG)
        with self.fails("INVALID_ARGUMENT", "there is no display 'TV'; there are: sRGB"):
            candela.bake_view(studio, "TV")
        with self.fails("INVALID_ARGUMENT", "there is no view of 'sRGB' 'Film'; there are: ACES, Plain"):
            candela.bake_view(studio, "sRGB", "Film")
        with self.fails("INVALID_ARGUMENT", "no colour space 'XYZ'; give the name of its linear light of Rec.709 as input: CIE-XYZ-D65, "):
            candela.bake_view(studio, input="XYZ")
        with self.fails("INVALID_ARGUMENT", "OpenColorIO"):
            candela.bake_view("no such file.ocio")


if __name__ == "__main__":
    unittest.main()
