"""The machine on which the numbers were taken; without it they mean nothing."""

import os
import platform
from pathlib import Path


def machine() -> dict[str, object]:
    """Return what a number depends on, as it is now."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 1),
    }


def described() -> str:
    """Return the machine as one line for a person."""
    found = machine()
    return (
        f"{found['processor']}, {found['cores']} cores, Linux {found['kernel']}, "
        f"Python {found['python']}, load {found['load']}"
    )


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
