"""The ids in a frame: how a function that may block says whom it works for, to whoever reads its stack.

A reader of stacks shows plain strings and cuts a long one in the middle, and an id that was cut is the id of
nobody. So several ids become one short text of whole ids, kept in a local of the frame. A comma stands between
them, as no id has one: a text with spaces might be a sentence, and evidence does not show sentences.
"""

from collections.abc import Iterable
from typing import Final

#: Below the 256 at which the tools cut.
SHOWN_CHARACTERS_MAX: Final = 240


def ids_shown(ids: Iterable[str]) -> str:
    """Return ids as one text, a comma between them: each once, and as many whole ones as are shown."""
    text = ""
    for name in dict.fromkeys(ids):
        longer = f"{text},{name}" if text and name else text or name
        if len(longer) > SHOWN_CHARACTERS_MAX:
            break
        text = longer
    return text
