"""Runs of `candela stream` for the deployment tests, and checks of their images."""
import hashlib
import json
import pathlib
import subprocess

from podman import expect, run


def digests(folder: pathlib.Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def expect_same(folder: pathlib.Path, expected: dict[str, str]) -> None:
    found = digests(folder)
    expect(found.keys() == expected.keys(), f"{folder.name}: missing or new: {sorted(found.keys() ^ expected.keys())[:9]}")
    other = [name for name in sorted(found) if found[name] != expected[name]]
    expect(not other, f"{folder.name}: these differ from an undisturbed run: {other[:9]}")


class Sessions:
    """`count` runs of `candela stream` over one film, each with its own output folder in `folder`."""

    def __init__(self, candela: str, folder: pathlib.Path, count: int, film: pathlib.Path, *options: object):
        self.folders = [folder / f"session-{i}" for i in range(count)]
        self.processes = [subprocess.Popen(
            [candela, "stream", str(film), str(folder), "--session", folder.name, "--resume", "60", "--json", f"{folder}.json",
             "-q", *map(str, options)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) for folder in self.folders]

    def going(self, results: int) -> bool:
        self.expect_running()
        return all(len(list(folder.glob("*.png"))) >= results for folder in self.folders)

    def state(self) -> str:
        return "\n".join(f"{folder.name}: {len(list(folder.glob('*.png')))} images, "
                         + ("goes on" if process.poll() is None else f"ended with {process.returncode}: {process.stderr.read()}")
                         for folder, process in zip(self.folders, self.processes))

    def expect_running(self) -> None:
        ended = [process.returncode for process in self.processes if process.poll() is not None]
        expect(not ended, f"sessions ended too early, with {ended}; make the film longer, unless they failed: "
               + "".join(process.stderr.read() for process in self.processes if process.returncode))

    def summaries(self, expected: dict[str, str]) -> list[dict]:
        """Waits until all sessions end. Expects every image of `expected` exactly once."""
        for folder, process in zip(self.folders, self.processes):
            errors = process.communicate(timeout=900)[1]
            expect(process.returncode == 0, f"{folder.name} ended with {process.returncode}: {errors}")
            expect_same(folder, expected)
        lines = [[json.loads(line) for line in pathlib.Path(f"{folder}.json").read_text().splitlines()] for folder in self.folders]
        for session in lines:
            numbers = [frame["frame"] for frame in session[:-1]]
            expect(numbers == list(range(len(expected))), f"a session's results came as {numbers}")
        return [session[-1]["summary"] for session in lines]

    def longest_gaps(self, since: float) -> list[float]:
        """For each session, the longest time between two images in the 10 s after `since`."""
        gaps = []
        for folder in self.folders:
            times = sorted(path.stat().st_mtime for path in folder.glob("*.png"))
            gaps.append(max((after - before for before, after in zip(times, times[1:]) if since < after and before < since + 10),
                            default=0))
        return gaps

    def kill(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


def make_film(candela: str, folder: pathlib.Path, size: str, seconds: float, sessions: int
              ) -> tuple[pathlib.Path, dict[str, str]]:
    """Makes a film that `sessions` sessions at once render in `seconds` to twice that on two cores, and its undisturbed images."""
    run(candela, "sample", "--sequence", folder / "scenes", "--size", size, "--frames", "48")
    trial = run(candela, "stream", folder / "scenes", folder / "trial", "--json", "-", "-q").splitlines()[-1]
    # Several sessions write at most twice as many images as one.
    together = json.loads(trial)["summary"]["frames_per_second"] * min(2, sessions)
    count = min(6000, max(240, round(together * seconds / sessions)))
    film = folder / "film"
    film.mkdir()
    scenes = sorted((folder / "scenes").iterdir())
    for i in range(count):  # forwards and backwards, so that the only jumps are the sequence's own
        j = i % (2 * len(scenes))
        (film / f"{i:05d}.exr").symlink_to(scenes[j if j < len(scenes) else 2 * len(scenes) - 1 - j])
    run(candela, "stream", film, folder / "undisturbed", timeout=900)
    return film, digests(folder / "undisturbed")
