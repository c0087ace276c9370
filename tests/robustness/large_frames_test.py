"""A client that streams large frames: large_frames_test.py [WIDTHxHEIGHT] [SECONDS]

The bystander waits for a slice of a frame and not for the frame, even the first one, whose memory is fresh.
"""
import sys
import time

import harness

SIZE, SECONDS = "16384x4096", 30


def main() -> None:
    size = sys.argv[1] if len(sys.argv) > 1 else SIZE
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else SECONDS
    width, height = map(int, size.split("x"))
    frame_bytes = width * height * 8
    with harness.Daemon("--memory-budget", "3GiB", "--max-frame-bytes", "1GiB") as daemon:
        control = harness.beside_fair_neighbour(daemon.address, seconds / 3)
        before = daemon.series("candela_bytes_total")['direction="in"']
        bystander = harness.Bystander(daemon.address)

        def arrived() -> float:
            return (daemon.series("candela_bytes_total")['direction="in"'] - before) / frame_bytes

        with harness.fair_neighbour(daemon.address, size):
            time.sleep(seconds)
            harness.expect(harness.wait_until(lambda: arrived() > 2, 400), f"only {arrived():.1f} frames arrive")
            beside = bystander.result()
        harness.report(size=size, arrived=round(arrived(), 1), control=control, beside=beside)
        harness.expect_undisturbed(beside, control, f"a stream of {size}", harness.NIGHTLY_NOISE_MS)
        if (size, seconds) == (SIZE, SECONDS):
            harness.record_p99("large_frames", beside, control)


main()
