"""The numbers of the policy that the hands need, apart from the hands: whoever only reads a policy loads none of them."""

import msgspec

from hardcore.host.lives import CoreLimits
from hardcore.snapshot.image import ImageLimits


class Bounds(msgspec.Struct, frozen=True):
    """What a core is told, and what a memory image may cost."""

    core: CoreLimits
    image: ImageLimits
