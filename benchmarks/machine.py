"""The machine, the versions and the commit that a time belongs to."""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

PACKAGES = ("numpy", "casadi", "llvmlite", "pin", "mujoco", "eaik", "roboticstoolbox-python", "toppra")
TOPOLOGY = Path("/sys/devices/system/cpu")


def processors() -> int:
    """Number that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cores() -> tuple[int | None, str]:
    """On how many physical cores those processors are, and in words; None where the system does not tell."""
    mine = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    groups: dict[tuple[str, str], list[int]] = {}
    for cpu in mine:
        place = TOPOLOGY / f"cpu{cpu}" / "topology"
        try:
            key = (place / "physical_package_id").read_text().strip(), (place / "core_id").read_text().strip()
        except OSError:
            return None, "this system does not tell which share a core"
        groups.setdefault(key, []).append(cpu)
    if not groups:
        return None, "this system does not tell which share a core"
    shared = [group for group in groups.values() if len(group) > 1]
    virtual = ", as a virtual machine is told" if _virtual() else ""
    if not shared:
        return len(groups), f"each on its own{virtual}"
    listed = "; ".join(" and ".join(map(str, group)) for group in shared[:4])
    more = " …" if len(shared) > 4 else ""
    return len(groups), f"processors {listed}{more} are hyper-threads that share a core{virtual}"


def described() -> dict[str, Any]:
    """Everything a saved table says of where it was made."""
    from armwright.kernels.target import select_target

    target = select_target()
    physical, text = cores()
    return {
        "date": datetime.date.today().isoformat(),
        "processor": processor_name(),
        "cpu": target.cpu,
        "width": target.width,
        "processors": processors(),
        "cores": physical,
        "topology": text,
        "load": [round(x, 2) for x in os.getloadavg()] if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.release()}",
        "versions": {"python": platform.python_version(), **{p: _version(p) for p in PACKAGES}, "armwright": _ours()},
        "commit": commit(),
    }


def processor_name() -> str:
    """As far as the system tells it."""
    for line in _cpuinfo():
        if line.startswith("model name"):
            return line.split(":")[1].split("@")[0].strip()
    return platform.processor() or platform.machine()


def commit() -> str:
    """Of the checkout, with "+" where files were changed since; "unknown" without git."""
    here = Path(__file__).parent
    try:
        asked = [["git", "rev-parse", "--short=12", "HEAD"], ["git", "status", "--porcelain", "--untracked-files=no"]]
        name, changed = (
            subprocess.run(words, cwd=here, capture_output=True, text=True, check=True).stdout.strip()
            for words in asked
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return name + ("+" if changed else "")


def _virtual() -> bool:
    return any(line.startswith("flags") and " hypervisor" in line for line in _cpuinfo())


def _cpuinfo() -> list[str]:
    info = Path("/proc/cpuinfo")
    return info.read_text().splitlines() if info.exists() else []


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _ours() -> str:
    import armwright

    return armwright.__version__
