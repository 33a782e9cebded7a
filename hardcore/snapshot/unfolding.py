"""A line of the core's log as a person and the rules of the investigators read it: JSON unfolded into plain lines.

The core writes one JSON object a line (`docs/wires.md` section 23), which is right for programs that collect logs. What is kept as
evidence is read by people, masked word by word, and searched for tracebacks, all of which want lines. A line that is
none of these objects (what the interpreter itself prints, or a C library) is left as it is.
"""

import json


def unfolded(line: str) -> list[str]:
    """Return the lines that stand in one line of a log."""
    if not line.startswith("{"):
        return [line]
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return [line]
    if not isinstance(said, dict) or not isinstance(said.get("text"), str):
        return [line]
    first, *more = said["text"].splitlines() or [""]
    return [f"{said.get('at', '')} {said.get('level', '')} {said.get('logger', '')} {first}", *more]
