"""`python -m core`: everything is loaded here, before anything is done.

Nothing of what is loaded is garbage, and looking for some on the way cost a tenth of the start: the collector
is switched on when the core is ready, by then with all of this set aside.
"""

import gc

gc.disable()

import os  # noqa: E402  after the line above, which is about all imports

if os.environ.get("HARDCORE_SPARE"):
    from core.loading import load_quietly

    load_quietly()

from core.main import cli  # noqa: E402  as above

cli()
