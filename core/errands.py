"""What falls due in a book: the sources that the scheduler asks, each a question that names errands.

Here, beside the scheduler and not in it, because what falls due is the ledger's business, and when it is asked is not.
"""

from typing import Final

from core.scheduler import Source

SOURCES: Final[tuple[Source, ...]] = ()
