"""Calls without a session, environments, security, and the package itself."""
import pathlib
import subprocess
import unittest

import candela_render as candela
import numpy
from support import BIN, Test, frames


class Calls(Test):
    def test_render_is_a_sessions_first_frame(self):
        scene = frames(1)[0]
        image, info = candela.render(scene, curve="hable", verify=True)
        with candela.Session(curve="hable") as session:
            numpy.testing.assert_array_equal(image, session(scene, time=0)[0])
        self.assertLess(info.verify.max_error_codes, 0.05)
        later = candela.render(scene, previous={"exposure": 1, "elapsed_seconds": 0})[1]
        self.assertEqual(later.exposure, 1)

    def test_an_hdr_display(self):
        white = numpy.ones((3, 5, 3), numpy.float32)
        image, info = candela.render(white, transfer="pq", curve="linear", exposure=1.0, bloom={"intensity": 0})
        self.assertEqual(image.dtype, numpy.uint16)
        numpy.testing.assert_allclose(image[..., :3] / 65535, 0.580688881, atol=1e-4)  # reference white, 203 nit
        self.assertAlmostEqual(info.max_light_nits, 203, 1)
        self.assertAlmostEqual(info.mean_light_nits, 203, 1)
        with candela.Session(transfer="hlg", peak_nits=600, exposure={"mode": "manual"}, bloom={"intensity": 0}) as session:
            image, info = session(white, time=0)
            self.assertEqual(image.dtype, numpy.uint16)
            self.assertTrue(150 < info.max_light_nits <= 203)
            with self.fails("INVALID_ARGUMENT", "between 400 and 2000"):
                session(white, time=1, peak_nits=300)

    def test_meter(self):
        metered = candela.meter(numpy.full((16, 16, 3), 0.5, numpy.float32))
        self.assertAlmostEqual(metered.statistics.mean_log2_luminance, -1, 3)
        first, share = candela.histogram(metered)
        self.assertAlmostEqual(share.sum(), 1)
        self.assertAlmostEqual(first[share.argmax()], -1, 1)

    def test_info_and_health(self):
        self.assertTrue(candela.health())
        self.assertIn("standard", [tier.name for tier in candela.info().tiers])

    def test_settings_are_those_of_the_server(self):
        names = {setting.path.partition(".")[0] for setting in candela.info().settings}
        self.assertEqual(names - set(candela.Settings.__dataclass_fields__), set())

    def test_refusals(self):
        scene = frames(1)[0]
        with self.fails("INVALID_ARGUMENT", "tint"):
            candela.render(scene, tint=0.5)  # in the server's words
        with self.fails("INVALID_ARGUMENT", "camera"):
            candela.render(scene, camera=3)
        with self.fails("INVALID_ARGUMENT", "a token is not sent"):
            candela.info("example.com:1", security=candela.Security(token_file="/dev/null"))
        with self.fails("INVALID_ARGUMENT", "HOST:PORT"):
            candela.Session("nonsense")


class Environments(Test):
    def test_views_and_bakes(self):
        panorama = numpy.full((32, 64, 3), 0.5, numpy.float32)
        try:
            sky = candela.Environment(panorama)
        except candela.Error as error:
            self.assertEqual(error.code, "FAILED_PRECONDITION")
            self.skipTest(error.message)
        image, _ = candela.render(sky.view(40, 20, camera={"yaw_deg": 30}, objects=[{"radius": 0.5, "centre": {"z": -2}}]))
        self.assertEqual(image.shape, (20, 40, 4))
        baked = sky.bake(size=16, pixels="rgba32f")
        numpy.testing.assert_allclose(baked.levels[0][..., :3], 0.5, rtol=1e-3)
        sky.drop()
        with candela.Session() as session:  # which puts it again
            self.assertEqual(session(sky.view(8, 8), time=0)[0].shape, (8, 8, 4))


class Secure(Test):
    def test_tls_and_token(self):
        folder = pathlib.Path(self.folder)
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout",
                        folder / "key.pem", "-out", folder / "cert.pem", "-subj", "/CN=candela.test", "-addext",
                        "subjectAltName=DNS:candela.test"], check=True, capture_output=True)
        token = folder / "token"
        token.write_text("# of the test\n0123456789abcdef0123456789abcdef\n")
        token.chmod(0o600)
        process = subprocess.Popen([BIN / "candelad", "--listen", "127.0.0.1:0", "--tls-cert", folder / "cert.pem", "--tls-key",
                                    folder / "key.pem", "--token-file", token, "--log-level", "off"], stdout=subprocess.PIPE)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        address = process.stdout.readline().decode().split()[-1]
        safe = dict(ca_file=str(folder / "cert.pem"), server_name="candela.test")
        with candela.Session(address, security=candela.Security(**safe, token_file=str(token))) as session:
            session(frames(1)[0], time=0)
        with self.fails("UNAUTHENTICATED"):
            candela.info(address, security=candela.Security(**safe))


if __name__ == "__main__":
    unittest.main()
