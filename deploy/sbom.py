#!/usr/bin/env python3
"""Writes an SBOM (SPDX 2.3) and a list of licences for a root file system.

sbom.py VERSION ROOT BUILD_LIST OUT
ROOT contains Debian packages and Candela VERSION. BUILD_LIST names the packages on this machine that Candela was built
with; code from their headers is in its programs. The files sbom.spdx.json and licenses.txt are written to the folder OUT.
"""
import hashlib
import json
import pathlib
import re
import subprocess
import sys
import time

FIELDS = {"name": "Package", "version": "Version", "architecture": "Architecture", "source": "source:Package",
          "source_version": "source:Version", "state": "db:Status-Status"}
# SPDX's names for Debian's short licence names (in lower case): first those that differ, then those that are the same.
SPDX = {"expat": "MIT", "apache-2": "Apache-2.0", "boost-1.0": "BSL-1.0", "cc0": "CC0-1.0", "bsd-2": "BSD-2-Clause",
        "bsd-3": "BSD-3-Clause"}
SPDX |= {name.lower(): name for name in (
    "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSD-4-Clause", "BSL-1.0", "CC0-1.0", "FSFAP", "FSFUL", "FSFULLR", "HPND",
    "ICU", "IJG", "ISC", "MIT", "MPL-1.1", "MPL-2.0", "NCSA", "OpenSSL", "Unlicense", "X11", "Zlib", "curl", "libpng")}
GNU = re.compile(r"((?:A|L)?GPL|GFDL)-(\d)(?:\.(\d))?(\+?)")


def spdx_id(name: str) -> str | None:
    """None if SPDX has no licence that is certainly the same."""
    gnu = GNU.fullmatch(name)
    if gnu:
        family, major, minor, later = gnu.groups()
        return f"{family}-{major}.{minor or 0}-{'or-later' if later else 'only'}"
    return SPDX.get(name.lower())


def packages(admin: pathlib.Path, names: list[str]) -> list[dict]:
    """The installed packages among `names`, or all installed packages if `names` is empty."""
    form = "\t".join(f"${{{field}}}" for field in FIELDS.values()) + "\n"
    lines = subprocess.run(["dpkg-query", f"--admindir={admin}", "--show", f"--showformat={form}", *names], check=True,
                           stdout=subprocess.PIPE, text=True).stdout.splitlines()
    found = [dict(zip(FIELDS, line.split("\t"), strict=True)) for line in lines]
    return [package for package in found if package["state"] == "installed"]


def licenses(text: str) -> tuple[list[str], bool]:
    """The licences that SPDX knows, and whether there are others, so that the full text is needed."""
    if not re.match(r"(?s).{0,300}^Format\S*:.*copyright-format", text, re.MULTILINE):
        return [], True
    named = re.findall(r"^License:[ \t]*(\S.*)$", text, re.MULTILINE)
    parts = {part.strip() for name in named for part in re.split(r",|\band\b", name)} - {""}
    ids = {spdx_id(part) for part in parts}
    return sorted(ids - {None}), None in ids or not ids


def describe(package: dict, root: pathlib.Path, prefix: str, texts: dict[str, str]) -> dict:
    """Returns an SPDX package. If its copyright file is needed, adds it to `texts` under its reference."""
    name, version = package["name"], package["version"]
    copyright_file = root / "usr/share/doc" / name / "copyright"
    if not copyright_file.is_file():
        raise SystemExit(f"{name}: there is no {copyright_file}; keep the copyright files of installed packages")
    text = copyright_file.read_text(errors="replace")
    ids, more = licenses(text)
    plain = re.sub("[^A-Za-z0-9.-]", "-", name)
    if more:
        ids.append(f"LicenseRef-{plain}")
        texts[ids[-1]] = text
    return {"SPDXID": f"SPDXRef-{prefix}-{plain}", "name": name, "versionInfo": version, "supplier": "Organization: Debian",
            "sourceInfo": f"built from {package['source']} {package['source_version']}",
            "downloadLocation": "NOASSERTION", "filesAnalyzed": False, "copyrightText": "NOASSERTION",
            "licenseConcluded": "NOASSERTION", "licenseDeclared": " AND ".join(ids),
            "externalRefs": [{"referenceCategory": "PACKAGE-MANAGER", "referenceType": "purl", "referenceLocator":
                              f"pkg:deb/debian/{name}@{version}?arch={package['architecture']}&distro=debian-12"
                              .replace("+", "%2B")}]}


def relation(subject: str, kind: str, to: str) -> dict:
    return {"spdxElementId": subject, "relationshipType": kind, "relatedSpdxElement": to}


def main() -> None:
    version, root, build_list, out = sys.argv[1], *map(pathlib.Path, sys.argv[2:])
    build_names = [line for line in build_list.read_text().split("\n") if line and not line.startswith("#")]
    texts: dict[str, str] = {}
    candela = {"SPDXID": "SPDXRef-candela", "name": "candela", "versionInfo": version, "downloadLocation": "NOASSERTION",
               "filesAnalyzed": False, "copyrightText": "NOASSERTION", "licenseConcluded": "Apache-2.0",
               "licenseDeclared": "Apache-2.0"}
    inside = [describe(package, root, "Package", texts) for package in packages(root / "var/lib/dpkg", [])]
    built_from = [describe(package, pathlib.Path("/"), "Build", texts)
                  for package in packages(pathlib.Path("/var/lib/dpkg"), build_names)]
    everything = [candela, *inside, *built_from]
    digest = hashlib.sha256(json.dumps(everything).encode()).hexdigest()
    document = {
        "spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT", "name": f"candela-{version}",
        "documentNamespace": f"https://spdx.org/spdxdocs/candela-{version}-{digest}",
        "creationInfo": {"created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
                         "creators": ["Tool: candela-sbom.py"]},
        "packages": everything,
        "relationships": [
            relation("SPDXRef-DOCUMENT", "DESCRIBES", candela["SPDXID"]),
            *(relation(candela["SPDXID"], "DEPENDS_ON", package["SPDXID"]) for package in inside),
            *(relation(package["SPDXID"], "BUILD_DEPENDENCY_OF", candela["SPDXID"]) for package in built_from)],
        "hasExtractedLicensingInfos": [{"licenseId": reference, "extractedText": text}
                                       for reference, text in sorted(texts.items())],
    }
    out.mkdir(parents=True, exist_ok=True)
    (out / "sbom.spdx.json").write_text(json.dumps(document, indent=1) + "\n")
    (out / "licenses.txt").write_text("".join(
        f"{package['name']} {package['versionInfo']}: {package['licenseDeclared']}\n" for package in everything))


if __name__ == "__main__":
    main()
