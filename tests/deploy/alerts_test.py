"""Checks deploy/prometheus.yaml and deploy/alerts.yaml with promtool and compares them with the runbook: alerts_test.py

Needs only promtool. Exits with 77 and a reason if it is missing.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
DEPLOY = HERE.parents[1] / "deploy"

if not shutil.which("promtool"):
    print("skipped: no promtool; as root: apt-get install prometheus")
    sys.exit(77)


def promtool(*arguments):
    done = subprocess.run(["promtool", *arguments], capture_output=True, text=True)
    # promtool reports some problems with exit code 0.
    if done.returncode != 0 or "FAILED" in done.stdout + done.stderr:
        sys.exit(f"promtool {' '.join(map(str, arguments))}:\n{done.stdout}{done.stderr}")


config = (DEPLOY / "prometheus.yaml").read_text()
alerts = (DEPLOY / "alerts.yaml").read_text()
cases = (HERE / "alerts_test.yaml").read_text()
promtool("check", "config", DEPLOY / "prometheus.yaml")
promtool("test", "rules", HERE / "alerts_test.yaml")

# Check the commented lines for Kubernetes too. Debian's Prometheus is built without that discovery; use another instead.
lines = re.sub(r"^    # (?=relabel_configs:|kubernetes_sd_configs:|  )", "    ", config, flags=re.M)
variant, count = re.subn(r"    static_configs:\n(.*\n)*    kubernetes_sd_configs:\n      - role: pod\n",
                         "    file_sd_configs:\n      - files: [none.json]\n", lines)
if count != 1:
    sys.exit("prometheus.yaml: cannot find the static targets or the lines for Kubernetes")
with tempfile.TemporaryDirectory() as scratch:
    pathlib.Path(scratch, "prometheus.yaml").write_text(variant)
    shutil.copy(DEPLOY / "alerts.yaml", scratch)
    promtool("check", "config", pathlib.Path(scratch, "prometheus.yaml"))

# Each alert has a case in which it fires, one in which it is silent, and a section in the runbook.
names = re.findall(r"^ *- alert: (\w+)$", alerts, flags=re.M)
headings = re.findall(r"^#+ (\w+)$", (DEPLOY / "README.md").read_text(), flags=re.M)
problems = []
for name in names:
    if not re.search(rf"alertname: {name}\n +exp_alerts:", cases):
        problems.append(f"{name}: no case in which it fires")
    if not re.search(rf"alertname: {name}}}", cases):
        problems.append(f"{name}: no case in which it is silent")
    if f"runbook_url: deploy/README.md#{name.lower()}\n" not in alerts:
        problems.append(f"{name}: no link to its section of the runbook")
    if name not in headings:
        problems.append(f"{name}: no section in deploy/README.md")
problems += [f"{name}: deploy/README.md explains it, but there is no such alert"
             for name in headings if name.startswith("Candela") and name != "Candela" and name not in names]
if problems or not names:
    sys.exit("\n".join(problems) or "there are no alerts")
print(f"{len(names)} alerts, {cases.count('eval_time')} cases")
