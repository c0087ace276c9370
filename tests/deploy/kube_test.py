"""Checks deploy/kube.yaml against Kubernetes' types, itself and candelad: kube_test.py CANDELAD VERSION

Needs no cluster and no network. The types come from Debian's python3-kubernetes, which is generated from Kubernetes'
OpenAPI description. Exits with 77 and a reason if that is missing.
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

try:
    import kubernetes.client.models as models
    import yaml
except ImportError as error:
    print(f"skipped: {error}; as root: apt-get install python3-kubernetes")
    sys.exit(77)

CANDELAD, VERSION = sys.argv[1:]
DEPLOY = pathlib.Path(__file__).resolve().parents[2] / "deploy"
STOP_GRACE_S = 20  # candelad and then the front may take this much longer than pre-drain and drain timeout
# The package knows Kubernetes 1.22, which has the autoscaling/v2 fields used here as v2beta2.
GROUPS = {
    "v1": "V1", "apps/v1": "V1", "policy/v1": "V1", "networking.k8s.io/v1": "V1", "autoscaling/v2": "V2beta2",
}
PLAIN = {"str": str, "int": int, "bool": bool, "object": (str, int)}

failures = []


def check(holds, message):
    if not holds:
        failures.append(message)


def check_type(value, kind, where):
    """Checks that `value` fits the OpenAPI type `kind`: no unknown field, no wrong type, no missing field."""
    if match := re.fullmatch(r"list\[(.*)\]", kind):
        check(isinstance(value, list), f"{where}: {value!r} is not a list")
        for i, item in enumerate(value if isinstance(value, list) else []):
            check_type(item, match[1], f"{where}[{i}]")
    elif match := re.fullmatch(r"dict\(str, (.*)\)", kind):
        check(isinstance(value, dict), f"{where}: {value!r} is not a map")
        for key, item in value.items() if isinstance(value, dict) else []:
            check_type(item, match[1], f"{where}.{key}")
    elif kind in PLAIN:
        fits = isinstance(value, PLAIN[kind]) and (kind == "bool" or not isinstance(value, bool))
        check(fits, f"{where}: {value!r} is not a {kind}")
    elif not isinstance(value, dict):
        check(False, f"{where}: {value!r} is not a {kind}")
    else:
        model = getattr(models, kind)
        names = {json: name for name, json in model.attribute_map.items()}
        for key, item in value.items():
            if key in names:
                check_type(item, model.openapi_types[names[key]], f"{where}.{key}")
            else:
                check(False, f"{where}.{key}: {kind} has no such field")
        try:
            model(**{names[key]: item for key, item in value.items() if key in names})
        except ValueError as error:  # it names the missing field
            check(False, f"{where}: {error}")


def seconds(text):
    """Seconds of a time as candelad writes it: 10s, 1m30s, 500ms, 0."""
    units = {"h": 3600, "m": 60, "s": 1, "ms": 0.001, "": 0}
    return sum(float(number) * units[unit] for number, unit in re.findall(r"([\d.]+)(h|ms|m|s|)", text))


def run_candelad(environment, *arguments):
    clean = {key: value for key, value in os.environ.items() if not key.startswith("CANDELA_")}
    command = [CANDELAD, *arguments]
    try:
        return subprocess.run(command, env=clean | environment, capture_output=True, text=True, timeout=30)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 0, "", "it is serving")


documents = list(yaml.safe_load_all((DEPLOY / "kube.yaml").read_text()))
for document in documents:
    kind = GROUPS.get(document["apiVersion"], "") + document["kind"]
    if hasattr(models, kind):
        check_type(document, kind, f"{document['kind']} {document['metadata']['name']}")
    else:
        check(False, f"{document['apiVersion']} has no {document['kind']} that this test knows")
if failures:
    sys.exit("\n".join(failures))

# Each kind appears once.
by_kind = {document["kind"]: document for document in documents}
check(len(by_kind) == len(documents), "two documents have the same kind; this test would check only one of them")
settings, secret = by_kind["ConfigMap"], by_kind["Secret"]
known = set(re.findall(r"Env:(CANDELA_\w+)", run_candelad({}, "--help").stdout))
check(len(known) > 10, "candelad --help lists no variables")
check(set(settings["data"]) <= known, f"candelad does not know {set(settings['data']) - known}")
if failures:
    sys.exit("\n".join(failures))

# The documents must fit each other.
deployment = by_kind["Deployment"]
labels = deployment["spec"]["template"]["metadata"]["labels"]
pod = deployment["spec"]["template"]["spec"]
containers = {container["name"]: container for container in pod["containers"]}
check(set(containers) == {"candelad", "proxy"}, f"the containers are {set(containers)}")
candelad, proxy = containers["candelad"], containers["proxy"]
environment = {variable["name"]: variable["value"] for variable in proxy["env"]}
known_to_proxy = set(re.findall(r"^#   (PROXY_\w+) ", (DEPLOY / "candela-front").read_text(), re.M))
check(set(environment) <= known_to_proxy, f"candela-front does not know {set(environment) - known_to_proxy}")
grpc = 50051  # candela-front's default
metrics, status = (int(address.rsplit(":", 1)[1]) for address in (settings["data"]["CANDELA_METRICS"], environment["PROXY_STATUS"]))
socket = settings["data"]["CANDELA_LISTEN"]
check(socket.startswith("unix:/") and socket == environment["PROXY_SERVER"],
      f"candelad listens on {socket}, but the proxy asks {environment['PROXY_SERVER']}")
tokens = settings["data"].get("CANDELA_TOKEN_FILE", "").rsplit("/", 1)[-1]
check(tokens == "tokens" and tokens in secret["stringData"], "candelad does not ask for the tokens of the Secret")

for where, selector in {
    "Deployment": deployment["spec"]["selector"]["matchLabels"],
    "topologySpreadConstraints": pod["topologySpreadConstraints"][0]["labelSelector"]["matchLabels"],
    "Service": by_kind["Service"]["spec"]["selector"],
    "PodDisruptionBudget": by_kind["PodDisruptionBudget"]["spec"]["selector"]["matchLabels"],
    "NetworkPolicy": by_kind["NetworkPolicy"]["spec"]["podSelector"]["matchLabels"],
}.items():
    check(selector.items() <= labels.items(), f"{where} selects {selector}, but the pods have {labels}")
target = by_kind["HorizontalPodAutoscaler"]["spec"]["scaleTargetRef"]
check((target["kind"], target["name"]) == ("Deployment", deployment["metadata"]["name"]),
      f"the autoscaler's target {target} is not the Deployment")
for reference in candelad["envFrom"]:
    check(reference["configMapRef"]["name"] == settings["metadata"]["name"], f"{reference}: there is no such ConfigMap")

volumes = {volume["name"]: volume for volume in pod["volumes"]}
mounts = {mount["mountPath"]: mount["name"] for mount in candelad["volumeMounts"]}
proxy_mounts = {mount["mountPath"]: mount["name"] for mount in proxy["volumeMounts"]}
used = {*mounts.values(), *proxy_mounts.values()}
check(used == set(volumes), f"mounts use {used}, but the volumes are {set(volumes)}")
folder = socket.removeprefix("unix:").rsplit("/", 1)[0]
check(mounts.get(folder) and mounts.get(folder) == proxy_mounts.get(folder), f"the containers do not share {folder}")
check(not any("secret" in volumes[name] for name in proxy_mounts.values()), "the proxy can read candelad's keys")
for name, value in settings["data"].items():
    for path, volume in mounts.items() if value.startswith("/") else []:
        if value.startswith(path + "/"):
            keys = secret["stringData"] if "secret" in volumes.get(volume, {}) else [value[len(path) + 1:]]
            check(value[len(path) + 1:] in keys, f"{name}: the Secret has no {value}")
            break
    else:
        check(not value.startswith("/"), f"{name}: {value} is on no volume")
for volume in volumes.values():
    if "secret" in volume:
        check(volume["secret"]["secretName"] == secret["metadata"]["name"], f"{volume}: there is no such Secret")
        check(volume["secret"]["defaultMode"] & 0o37 == 0 and "fsGroup" in pod["securityContext"],
              f"{volume}: candelad refuses a key that anyone can read")
for container in containers.values():
    check(container["image"] == f"localhost/candela:{VERSION}",
          f"the image is {container['image']}, but this is version {VERSION}")
    check("ports" not in container, "podman would open the container's ports on the host")
    check(container["securityContext"] == {"readOnlyRootFilesystem": True, "allowPrivilegeEscalation": False,
                                           "capabilities": {"drop": ["ALL"]}}, f"{container['name']} has more rights")
    check(container["resources"]["requests"] == container["resources"]["limits"], "a pod short of memory goes first")

wanted = [(probe, candelad[probe]["httpGet"]["port"], metrics)
          for probe in ("startupProbe", "readinessProbe", "livenessProbe")]
wanted += [(f"the proxy's {probe}", proxy[probe]["httpGet"]["port"], status) for probe in ("readinessProbe", "livenessProbe")]
wanted += [("Service", port.get("targetPort", port["port"]), grpc) for port in by_kind["Service"]["spec"]["ports"]]
for where, port, listens in wanted:
    check(port == listens, f"{where}: port {port}, but candelad listens on {listens}")
lets_in = {next(iter(next(iter(source.values()))["matchLabels"])): {port["port"] for port in rule["ports"]}
           for rule in by_kind["NetworkPolicy"]["spec"]["ingress"] for source in rule["from"]}
check(lets_in == {"candela-client": {grpc}, "candela-proxy": {grpc, metrics}, "kubernetes.io/metadata.name": {metrics, status}},
      f"NetworkPolicy: {lets_in}, but candelad listens on {grpc} and {metrics}, which a proxy needs, and the front on {status}")
check("replicas" not in deployment["spec"], "an apply would reset the autoscaler's replicas")
scaler, budget = by_kind["HorizontalPodAutoscaler"]["spec"], by_kind["PodDisruptionBudget"]["spec"]
check(scaler["minReplicas"] > budget["maxUnavailable"], "a disruption may take every replica of the smallest fleet")

stop = seconds(settings["data"]["CANDELA_PRE_DRAIN"]) + seconds(settings["data"]["CANDELA_DRAIN_TIMEOUT"])
grace = pod["terminationGracePeriodSeconds"]
check(grace >= stop + STOP_GRACE_S, f"the pod may take {stop + STOP_GRACE_S:g} s to stop, but is killed after {grace} s")

# candelad must accept the settings.
tried = run_candelad(settings["data"], "--list-devices")
check(tried.returncode == 0, f"candelad does not accept the ConfigMap: {tried.stderr.strip()}")
with tempfile.TemporaryDirectory() as scratch:
    keys = pathlib.Path(scratch, "resume-keys")
    keys.touch(0o600)
    keys.write_text(secret["stringData"]["resume-keys"])
    tried = run_candelad({}, "--listen", "127.0.0.1:0", "--resume-keys", str(keys))
    check(tried.returncode != 0 and "resume-keys" in tried.stderr, f"candelad accepts the placeholder as a key: {tried}")


def check_pod_monitor(monitor, those):
    """The PodMonitor finds its ports in `those` containers, and gives its targets the job that the alerts ask for."""
    spec = monitor["spec"]
    check(spec["selector"]["matchLabels"].items() <= labels.items(), "the PodMonitor selects other pods")
    check(labels.get(spec.get("jobLabel")) == "candela", "the PodMonitor's job is not candela")
    ports = {port["name"]: port["containerPort"] for one in those for port in one.get("ports", [])}
    asked = [ports.get(end.get("port")) for end in spec["podMetricsEndpoints"]]
    check(asked == [metrics, status], f"the PodMonitor asks the ports {asked}, not {metrics} and {status}")


component = DEPLOY / "kube-podmonitor"
[patch] = yaml.safe_load((component / "kustomization.yaml").read_text())["patches"]
patched = yaml.safe_load(patch["patch"])["spec"]["template"]["spec"]["containers"]
check({one["name"] for one in patched} == set(containers), f"deploy/kube-podmonitor changes the containers {patched}")
check_pod_monitor(yaml.safe_load((component / "podmonitor.yaml").read_text()), patched)

# The manifest as the cluster gets it. Older versions cannot read the file.
kubectl, built = shutil.which("kubectl"), None
version = [kubectl, "version", "--client", "--output=json"]
minor = kubectl and re.search(r'"gitVersion": "v1\.(\d+)', subprocess.run(version, capture_output=True, text=True).stdout)
if minor and int(minor[1]) >= 21:
    with tempfile.TemporaryDirectory() as scratch:
        base = os.path.relpath(DEPLOY, os.path.realpath(scratch))
        pathlib.Path(scratch, "kustomization.yaml").write_text(
            f"apiVersion: kustomize.config.k8s.io/v1beta1\nkind: Kustomization\nresources: [{base}]\n"
            f"components: [{base}/kube-tls, {base}/kube-podmonitor]\n")
        built = subprocess.run([kubectl, "kustomize", scratch], capture_output=True, text=True)
    check(built.returncode == 0, f"kubectl kustomize: {built.stderr.strip()}")
    made = {document["kind"]: document for document in yaml.safe_load_all(built.stdout)}
    check({*made} == {*by_kind, "PodMonitor"}, f"the overlay has {set(made)}")
    if "Deployment" in made:
        check_type(made["Deployment"], "V1Deployment", "Deployment with TLS")
        [front] = [one for one in made["Deployment"]["spec"]["template"]["spec"]["containers"] if one["name"] == "proxy"]
        set_to = {variable["name"]: variable["value"] for variable in front["env"]}
        check(set_to["PROXY_INSECURE"] == "false" and set_to["PROXY_SERVER"] == socket, f"with TLS, the proxy has {set_to}")
        check(any(set_to["PROXY_CERT"].startswith(mount["mountPath"] + "/") for mount in front["volumeMounts"]),
              "the certificate is on no volume")
    if {"Deployment", "PodMonitor"} <= set(made):
        check_pod_monitor(made["PodMonitor"], made["Deployment"]["spec"]["template"]["spec"]["containers"])

if failures:
    sys.exit("\n".join(failures))
if not built:
    print("skipped: there is no kubectl 1.21 or later, so the kustomizations were not tested; all else passed")
    sys.exit(77)
print(f"{len(documents)} documents, {len(settings['data'])} of candelad's {len(known)} variables")
