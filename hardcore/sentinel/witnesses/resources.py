"""The witness of the resources: how much memory does the core hold? Worth saying, never a verdict by itself."""

from hardcore.model.looks import ProcessSample
from hardcore.model.verdicts import Colour, Testimony


def testify(sample: ProcessSample, memory_bytes: int) -> Testimony | None:
    """Return that the core holds more than `memory_bytes` (0: there is no limit), or None."""
    if not memory_bytes or sample.rss_bytes <= memory_bytes:
        return None
    why = f"the core holds {sample.rss_bytes >> 20} MiB of memory; {memory_bytes >> 20} MiB are allowed"
    return Testimony("resources", Colour.YELLOW, why)
