"""The control of every verdict on latency: a server that stands still for two seconds is seen."""
import signal
import time

import harness


def main() -> None:
    with harness.Daemon() as daemon:
        control = harness.beside_fair_neighbour(daemon.address, seconds=4)
        bystander = harness.Bystander(daemon.address)
        time.sleep(2)
        daemon.process.send_signal(signal.SIGSTOP)
        time.sleep(2)
        daemon.process.send_signal(signal.SIGCONT)
        time.sleep(1)
        stopped = bystander.result()
        harness.report(control=control, stopped=stopped)
        try:
            harness.expect_undisturbed(stopped, control, "a server that stands still")
        except SystemExit as seen:
            harness.expect("p99" in str(seen), f"it was seen for another reason: {seen}")
            harness.record_p99("control", stopped, control)
            return
        harness.expect(False, f"a stop of two seconds was not seen: {stopped}, control {control}")


main()
