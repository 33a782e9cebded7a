"""Allows the guard to look into this process.

Where the kernel's Yama module is on, a process may trace its children only, and a core that outlives its
sentinel is no child of the next one. So the core allows every process of its own user, who could do the
same everywhere else; naming the sentinel's pid alone would blind each successor.
"""

import ctypes

_PR_SET_PTRACER = 0x59616D61
_PR_SET_PTRACER_ANY = ctypes.c_ulong(-1)


def allow_tracing() -> bool:
    """Let processes of the same user trace this one; return whether the kernel took it.

    False means EINVAL: a kernel without Yama, where nothing needed to be allowed.
    """
    nothing = ctypes.c_ulong(0)
    libc = ctypes.CDLL(None)
    return bool(libc.prctl(_PR_SET_PTRACER, _PR_SET_PTRACER_ANY, nothing, nothing, nothing) == 0)
