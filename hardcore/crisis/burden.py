"""What all sockets together keep in memory that is not on its way yet, against one bound. Pure.

One socket's own bounds are wide enough for a page that reads slowly for a moment; five hundred of them at
once would be a gigabyte in the process that has to outlive everything. So each socket counts what it keeps
here, and the one that grows while there is no room ends. Narrow bounds for each were not chosen: they would
end honest sockets on an idle machine.
"""


class Burden:
    """The sum."""

    def __init__(self, bytes_max: int) -> None:
        self.bytes = 0
        self._bytes_max = bytes_max

    @property
    def bearable(self) -> bool:
        """Whether there is room for what is kept."""
        return self.bytes <= self._bytes_max

    def share(self) -> "Share":
        """A part of it that nobody counts yet."""
        return Share(self)


class Share:
    """What one end of one socket keeps in one place."""

    __slots__ = ("_burden", "_bytes")

    def __init__(self, burden: Burden) -> None:
        self._burden = burden
        self._bytes = 0

    def weighs(self, size: int) -> bool:
        """It keeps `size` bytes now, counted whatever comes of it; False: it grew, and there is no room for that."""
        grown, self._bytes = size - self._bytes, size
        self._burden.bytes += grown
        return grown <= 0 or self._burden.bearable
