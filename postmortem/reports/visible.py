"""Makes other people's text harmless where it is shown: what can't be seen is written out.

Control characters move a terminal's cursor, change its title or fake a line; direction marks and other
invisible ones turn what is read around. All of them appear as an escape, everything printable as itself.
"""


def visible(text: str) -> str:
    r"""Return `text` with every character that does not print as an escape such as `\x1b`."""
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else _escaped(one) for one in text)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
