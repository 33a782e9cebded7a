"""The guard's own values as JSON, and back: facts, orders and everything a manager remembers.

Only classes that were handed in can be written or read; a name in a file is looked up among these and never
imported, so a file can say nothing that the guard could not have said itself. A struct or a dataclass is an object
with one key, its class; what is at its default is left out. What JSON lacks carries a `$` and a name. Pickle was not
chosen: it runs what it reads. A table of fields by hand was not chosen either: it would be a second model, and
the first change to the real one would make every recording lie. Values that many share come back as many: so
nothing that is written may be one mutable thing in two places.
"""

import dataclasses
import functools
import hashlib
import types
import typing
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from typing import Any

import msgspec
from msgspec import structs

#: How deep a value may be nested, and how many parts one may have.
DEPTH_MAX = 40
NODES_MAX = 2_000_000
#: What a file said is repeated up to so many characters.
SHOWN_MAX = 60

Json = Any


class Undecodable(msgspec.Struct, frozen=True):
    """A JSON value that is none of ours, and why."""

    reason: str


class UnencodableError(TypeError):
    """A value holds something that this codec was not made for: a bug of whoever keeps it."""


class _StrangeError(ValueError):
    """The argument says what is wrong with a JSON value."""


class _Field(msgspec.Struct, frozen=True):
    """One field of a class. `needed`: it has no default, so it must be said. `written`: what is said
    instead of what it holds, if that is none of the reader's business.
    """

    name: str
    default: Any
    make: Callable[[], Any] | None
    needed: bool
    blank: bool
    written: Any

    def absent(self) -> Any:
        """Return what the field is if nothing is said of it."""
        return self.make() if self.make else self.default


class _Plan(msgspec.Struct, frozen=True):
    """How one class is written and read."""

    name: str
    fields: tuple[_Field, ...]


class Codec:
    """Writes and reads values made of `classes` (structs, dataclasses and enums), plain values and collections.

    `blank`: what is written for a field whatever it holds, because nobody may read it there.
    """

    def __init__(
        self, classes: Iterable[type], blank: Mapping[type, Mapping[str, Any]] = types.MappingProxyType({})
    ) -> None:
        known = sorted(set(classes), key=lambda cls: (cls.__name__, cls.__module__))
        names = [cls.__name__ for cls in known]
        self._classes: dict[str, type] = {}
        self._plans: dict[type, _Plan] = {}
        for cls in known:
            # Two rooms may use one word: then the room is said with it.
            alone = names.count(cls.__name__) == 1
            name = cls.__name__ if alone else f"{cls.__module__.removeprefix('hardcore.')}.{cls.__name__}"
            self._classes[name] = cls
            if not issubclass(cls, Enum):
                self._plans[cls] = _plan(cls, name, blank.get(cls, {}))
        self._names = {cls: name for name, cls in self._classes.items()}

    @property
    def classes(self) -> tuple[type, ...]:
        """Return what this codec knows."""
        return tuple(self._names)

    @property
    def shape(self) -> str:
        """Return a fingerprint of every class and its fields: another one is another version's."""
        told = [
            f"{name}({', '.join(f.name for f in self._plans[cls].fields)})"
            if cls in self._plans
            else f"{name}{[member.name for member in cls]}"  # type: ignore[attr-defined]  # no plan: an enum
            for name, cls in self._classes.items()
        ]
        return hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]

    # ---- writing ----

    def encode(self, value: Any) -> Json:
        """Return `value` as JSON. Raises `UnencodableError` for what nobody has named."""
        kind = type(value)
        if value is None or kind in {bool, int, str}:
            return value
        plan = self._plans.get(kind)
        if plan is not None:
            return {plan.name: self._fields(plan, value)}
        if kind is tuple:
            return [self.encode(part) for part in value]
        return self._other(kind, value)

    def _fields(self, plan: _Plan, value: Any) -> dict[str, Json]:
        told = {}
        for field in plan.fields:
            part = field.written if field.blank else getattr(value, field.name)
            usual = not field.needed and not field.make and type(part) is type(field.default)
            if not usual or part != field.default:
                told[field.name] = self.encode(part)
        return told

    def _other(self, kind: type, value: Any) -> Json:
        if issubclass(kind, Enum) and kind in self._names:
            return {"$enum": f"{self._names[kind]}.{value.name}"}
        if kind is float and value - value == 0:  # neither infinite nor nothing
            return value
        if kind is bytes:
            return {"$bytes": value.hex()}
        if kind is list:
            return {"$list": [self.encode(part) for part in value]}
        if kind is deque:
            return {"$deque": [self.encode(part) for part in value], "$max": value.maxlen}
        if kind in {frozenset, set}:
            parts = sorted((self.encode(part) for part in value), key=repr)
            return {"$frozenset" if kind is frozenset else "$set": parts}
        if kind in {dict, types.MappingProxyType}:
            return {"$map": [[self.encode(key), self.encode(part)] for key, part in value.items()]}
        raise UnencodableError(f"{kind.__module__}.{kind.__qualname__} can't be written down")

    # ---- reading ----

    def decode(self, raw: Json) -> Any:
        """Return the value that a JSON value tells, or `Undecodable`. Nothing raises, whatever it is."""
        try:
            return _Reader(self._classes, self._plans).read(raw, 0)
        except _StrangeError as strange:
            return Undecodable(str(strange))


def _plan(cls: type, name: str, blank: Mapping[str, Any]) -> _Plan:
    fields = []
    for field in _fields_of(cls):
        make = None if _is_nothing(field.default_factory) else field.default_factory
        needed = _is_nothing(field.default) and make is None
        default = None if _is_nothing(field.default) else field.default
        fields.append(_Field(field.name, default, make, needed, field.name in blank, blank.get(field.name)))
    return _Plan(name, tuple(fields))


def _fields_of(cls: type) -> Iterable[Any]:  # Any: two libraries' words, alike in all that is asked here
    if issubclass(cls, msgspec.Struct):
        return structs.fields(cls)
    assert dataclasses.is_dataclass(cls), f"{cls} is neither a struct nor a dataclass nor an enum"
    return dataclasses.fields(cls)


def _is_nothing(default: object) -> bool:
    return default is dataclasses.MISSING or default is msgspec.NODEFAULT


@functools.cache
def _hints(cls: type) -> Mapping[str, Any]:
    """Return the types of a class's fields; nothing where only a type checker can know them."""
    try:
        return typing.get_type_hints(cls)
    except NameError:
        return {}


class _Reader:
    """Reads one value; counts its parts."""

    def __init__(self, classes: Mapping[str, type], plans: Mapping[type, _Plan]) -> None:
        self.classes = classes
        self.plans = plans
        self.nodes = 0

    def read(self, raw: Json, depth: int) -> Any:
        """Return the value. Raises `_StrangeError`."""
        self.nodes += 1
        if depth > DEPTH_MAX or self.nodes > NODES_MAX:
            raise _StrangeError("nested too deeply" if depth > DEPTH_MAX else "too many parts")
        if raw is None or isinstance(raw, bool | int | float | str):
            return raw
        if isinstance(raw, list):
            return tuple(self.read(part, depth + 1) for part in raw)
        if not isinstance(raw, dict) or not raw:
            raise _StrangeError(f"{_shown(raw)} tells nothing")
        tag, body = next(iter(raw.items()))
        if len(raw) > (2 if tag == "$deque" else 1):
            raise _StrangeError(f"{_shown(tag)} with more beside it")
        if isinstance(tag, str) and tag.startswith("$"):
            return self._tagged(tag, body, raw.get("$max"), depth)
        return self._made(tag, body, depth)

    def _tagged(self, tag: str, body: Json, most: Json, depth: int) -> Any:
        if tag == "$enum":
            return self._member(body)
        if tag == "$bytes":
            return _bytes(body)
        if not isinstance(body, list):
            raise _StrangeError(f"{_shown(tag)} without its parts")
        parts = [self.read(part, depth + 1) for part in body]
        try:
            match tag:
                case "$list":
                    return parts
                case "$deque":
                    return _bounded(parts, most)
                case "$frozenset":
                    return frozenset(parts)
                case "$set":
                    return set(parts)
                case "$map":
                    return dict(parts)
                case _:
                    raise _StrangeError(f"{_shown(tag)} is no word for a collection")
        except (TypeError, ValueError) as error:
            raise _StrangeError(f"{_shown(tag)}: {error}") from None

    def _member(self, body: Json) -> Any:
        name, _, member = str(body).rpartition(".")
        cls = self.classes.get(name)
        if cls is None or not issubclass(cls, Enum) or member not in cls.__members__:
            raise _StrangeError(f"{_shown(body)} is no word of ours")
        return cls[member]

    def _made(self, name: Json, body: Json, depth: int) -> Any:
        plan = self.plans.get(self.classes.get(name, object))
        if plan is None or not isinstance(body, dict):
            raise _StrangeError(f"{_shown(name)} is nothing we know")
        if strange := set(body) - {field.name for field in plan.fields}:
            raise _StrangeError(f"{name} has no {_shown(min(strange))}")
        cls = self.classes[name]
        values = {}
        for field in plan.fields:
            if field.name not in body:
                if field.needed:
                    raise _StrangeError(f"{name} without {field.name}")
                values[field.name] = field.absent()
            else:
                values[field.name] = self.read(body[field.name], depth + 1)
                if not _fits(values[field.name], _hints(cls).get(field.name, Any)):
                    raise _StrangeError(f"{name}.{field.name} can't be {_shown(body[field.name])}")
        return _filled(cls, values)


def _filled(cls: type, values: Mapping[str, Any]) -> Any:
    if issubclass(cls, msgspec.Struct):
        return cls(**values)
    made: Any = object.__new__(cls)
    for name, value in values.items():
        object.__setattr__(made, name, value)  # frozen ones, and what no constructor takes
    return made


def _bytes(body: Json) -> bytes:
    try:
        return bytes.fromhex(body)
    except (TypeError, ValueError):
        raise _StrangeError("bytes that are no hex digits") from None


def _bounded(parts: list[Any], most: Json) -> deque[Any]:
    if most is not None and (not isinstance(most, int) or most < len(parts)):
        raise _StrangeError("a queue with more than its most")
    return deque(parts, most)


def _fits(value: Any, hint: Any) -> bool:
    """Tell whether `value` is of the type `hint`, as far as types say."""
    origin: Any
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in {typing.Union, types.UnionType}:
        return any(_fits(value, one) for one in inside)
    if origin is None:
        plain = types.NoneType if hint is None else hint
        if plain is float:
            return isinstance(value, float | int) and not isinstance(value, bool)
        return not isinstance(plain, type) or (isinstance(value, plain) and _is_number(value, plain))
    if not isinstance(origin, type):
        return True  # a type that is no class of its own says nothing here
    if not isinstance(value, origin):
        return False
    parts: Any = value
    if isinstance(parts, Mapping):
        return all(_fits(key, inside[0]) and _fits(part, inside[1]) for key, part in parts.items())
    if origin is tuple and not (len(inside) == 2 and inside[1] is Ellipsis):
        return len(parts) == len(inside) and all(map(_fits, parts, inside))
    return all(_fits(part, inside[0]) for part in parts)


def _is_number(value: Any, plain: type) -> bool:
    return plain is not int or not isinstance(value, bool)


def _shown(raw: Json) -> str:
    text = ascii(raw)
    return text if len(text) <= SHOWN_MAX else text[: SHOWN_MAX - 3] + "..."
