"""The form of the evidence's JSON files: readable by a person with nothing but a shell, total for any text."""

import json


def as_bytes(value: object) -> bytes:
    """Return a value as the bytes of a JSON file; a lone surrogate, which UTF-8 can't carry, as an escape."""
    return json.dumps(value, ensure_ascii=False, indent=1).encode("utf-8", "backslashreplace")
