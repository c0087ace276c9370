"""promises.py refuses what it is there to refuse: names that nothing has, and a page that is not what it was made from."""
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

ROWS = """
title = "Promises"
intro = "Each row."
end = "Run them."
[Clients."A cut"]
promise = "It goes on"
tests = ["{test}", "sim:{simulated}"]
figure = "{figure}"
"""
SOURCE = """
TEST(Cut, GoesOn) { record_figure("cut", 1, "ms", 2); }
TEST(Cut, DISABLED_Never) {}
TEST_P(Each, Way) {}
INSTANTIATE_TEST_SUITE_P(All, Each, Values("Short"));
"""
BUILD = "candela_test(a SOURCES a_test.cc)\nforeach(claim Holds)\n  add_test(NAME Loop.${claim} COMMAND true)\nendforeach()\n"


class Promises(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="candela-promises-")
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        for name in ("tests", "docs"):
            (self.root / name).mkdir()
        shutil.copy(pathlib.Path(__file__).with_name("promises.py"), self.root / "tests")
        self.put("a_test.cc", SOURCE)
        self.put("CMakeLists.txt", BUILD)
        self.put("figures.json", "{}")
        (self.root / "tests/simulator").mkdir()
        self.put("simulator/history.cc", '      {"cut", "a connection is cut", nullptr},\n')

    def put(self, name: str, text: str) -> pathlib.Path:
        path = self.root / "tests" / name
        path.write_text(text)
        return path

    def rows(self, test="Cut.Goes*", simulated="cut", figure="cut"):
        self.put("promises.toml", ROWS.format(test=test, simulated=simulated, figure=figure))

    def ends(self, *options, code=1) -> str:
        run = subprocess.run([sys.executable, "-B", self.root / "tests/promises.py", *options], capture_output=True, text=True)
        self.assertEqual((run.returncode, run.stderr), (code, ""), run.stdout)
        return run.stdout

    def page(self) -> str:
        return (self.root / "docs/robustness.md").read_text()

    def test_takes_a_page_that_is_up_to_date(self):
        for test in ("Cut.GoesOn", "Each.Way/Short", "Loop.Holds"):
            self.rows(test)
            self.ends("--write", code=0)
            self.ends(code=0)
        self.assertIn("| A cut | It goes on | | `Loop.Holds`, simulator: `cut` |\n", self.page())

    def test_refuses_a_stale_page(self):
        self.rows()
        self.ends("--write", code=0)
        self.rows("Cut.GoesOn")
        self.assertIn("docs/robustness.md is not what", self.ends())

    def test_refuses_names_of_no_test(self):
        for test in ("Cut.Stays", "Cut.*Never", "Each.Way/Long", "Loop.Breaks"):
            self.rows(test)
            self.assertEqual(f"no test is called {test}\n", self.ends("--write"))

    def test_refuses_tests_that_are_not_built_or_disabled(self):
        self.rows()
        self.put("CMakeLists.txt", "candela_test(a SOURCES b_test.cc)")
        self.assertEqual("no test is called Cut.Goes*\n", self.ends("--write"))
        self.put("CMakeLists.txt", BUILD + "set_tests_properties(Loop.Holds PROPERTIES DISABLED ON)")
        self.assertEqual("tests/CMakeLists.txt disables a test\n", self.ends("--write"))

    def test_knows_the_faults_of_the_simulator(self):
        self.rows(simulated="burn")
        self.assertEqual("the simulator has no fault burn\nno promise names the simulator's fault cut\n", self.ends("--write"))

    def test_shows_the_figure_of_the_last_run(self):
        self.rows()
        lines = '{"figure": "cut", "value": 31.5, "unit": "ms", "against": 8}\n{"figure": "cut", "value": 9.25, "unit": "ms"}\n'
        self.ends("--record", "c0ffee", self.put("first", lines.splitlines()[0]), code=0)
        self.assertNotIn('"figure"', (self.root / "tests/figures.json").read_text())
        self.assertRegex(self.page(), r"\| 32 ms \(8\.0\), 20\d\d-\d\d-\d\d \| `Cut\.Goes\*`, simulator: `cut` \|\n")
        self.ends("--record", "c0ffee", self.put("both", lines), code=0)
        self.assertRegex(self.page(), r"\| 9\.2 ms, 20\d\d-\d\d-\d\d \| `Cut\.Goes\*`, simulator: `cut` \|\n")

    def test_refuses_figures_that_nobody_records_or_shows(self):
        self.rows(figure="burn")
        self.put("figures.json", '{"cut": {"value": 1, "unit": "ms", "date": "2026-11-27", "commit": "", "processor": ""}}')
        self.assertEqual("no promise shows the figure cut of figures.json\nno test records the figure burn\n", self.ends("--write"))


unittest.main()
