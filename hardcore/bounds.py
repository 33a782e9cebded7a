"""The numbers of the policy that the hands need, apart from the hands: whoever only reads a policy loads none of them."""

from dataclasses import dataclass

from hardcore.host.lives import CoreLimits
from hardcore.snapshot.image import ImageLimits


@dataclass(frozen=True, slots=True)
class Bounds:
    """What a core is told, and what a memory image may cost."""

    core: CoreLimits
    image: ImageLimits
