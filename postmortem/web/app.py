"""The table of the dashboard's addresses.

One line for each, so that all of them can be read at once; what a page shows stands in the room named beside it.
"""

from starlette.routing import Route

from postmortem.views import Acts, Reads
from postmortem.web.places import Places


def routes(reads: Reads, acts: Acts, places: Places) -> list[Route]:
    """Return the pages under `/admin/`, for the investigator's server."""
    assert reads is not None and acts is not None and places is not None
    return []
