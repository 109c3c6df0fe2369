"""Values of known kinds as what msgpack can hold, and back, bit for bit.

A coder is made from the kind that is expected: a class, its annotations, a value to compare with. What is encoded names no
class: whoever sends it cannot choose what is built. A value of another kind is a `Misfit`, when encoding as when decoding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from milepost_schemas import Message, Refused, decode, encode

# a number of numpy is not a float where it divides by zero, so that it has to stay what it is
NUMBER_OF_NUMPY = "f8"


class Misfit(ValueError):
    """A value is not of the expected kind."""


@dataclass(frozen=True)
class Coder:
    """The two ways of one kind of value. `unpack` raises Misfit for anything that `pack` cannot have made.

    `same`: values of this class are the same packed and unpacked.
    """

    pack: Callable[[Any], Any]
    unpack: Callable[[Any], Any]
    same: type | None = None


def _checked(expected: type, value: Any) -> Any:
    if type(value) is not expected:
        raise Misfit(f"{expected.__name__} expected, not {type(value).__name__}")
    return value


def plain(kind: type) -> Coder:
    """A value that msgpack holds as it is, and of no subclass: True is no int."""

    def check(value: Any) -> Any:
        return _checked(kind, value)

    return Coder(check, check, kind)


def _pack_float(value: Any) -> Any:
    return [NUMBER_OF_NUMPY, float(value)] if type(value) is np.float64 else _checked(float, value)


def _unpack_float(value: Any) -> Any:
    if type(value) is list and len(value) == 2 and value[0] == NUMBER_OF_NUMPY:
        return np.float64(_checked(float, value[1]))
    return _checked(float, value)


FLOAT = Coder(_pack_float, _unpack_float, float)
NONE, TEXT, INT, BOOL = plain(NoneType), plain(str), plain(int), plain(bool)


def either(*coders: Coder) -> Coder:
    """A value of one of several kinds: the first that takes it."""

    def first(ways: Sequence[Callable[[Any], Any]], value: Any) -> Any:
        for way in ways:
            try:
                return way(value)
            except Misfit as misfit:
                last = misfit
        raise last

    packs, unpacks = [c.pack for c in coders], [c.unpack for c in coders]
    return Coder(lambda value: first(packs, value), lambda value: first(unpacks, value))


def sequence(kind: type, item: Coder) -> Coder:
    """A list or tuple of one kind of values, as long as it likes."""

    def each(way: Callable[[Any], Any], values: Any) -> Any:
        # thousands of times and numbers are not looked at one by one
        return values if set(map(type, values)) == {item.same} else map(way, values)

    return Coder(
        lambda value: list(each(item.pack, _checked(kind, value))),
        lambda value: kind(each(item.unpack, _checked(list, value))),
    )


def a_set(item: Coder) -> Coder:
    """A frozenset; in order, so that equal sets become equal bytes."""
    return Coder(
        lambda value: sorted(item.pack(each) for each in _checked(frozenset, value)),
        lambda value: frozenset(item.unpack(each) for each in _checked(list, value)),
    )


def mapping(value_of: Callable[[str], Coder]) -> Coder:
    """A dict whose keys are texts; `value_of` gives the kind of each value, and raises Misfit for a key that there is not."""

    def pack(value: Any) -> Any:
        return {TEXT.pack(key): value_of(key).pack(each) for key, each in _checked(dict, value).items()}

    def unpack(value: Any) -> Any:
        return {TEXT.unpack(key): named(key, value_of(key).unpack, each) for key, each in _checked(dict, value).items()}

    return Coder(pack, unpack)


def named(name: str, way: Callable[[Any], Any], value: Any) -> Any:
    """`way(value)`; a misfit says where it is."""
    try:
        return way(value)
    except Misfit as misfit:
        raise Misfit(f"{name}: {misfit}") from None


def fixed(build: Callable[..., Any], kind: type, fields: Mapping[str, Coder]) -> Coder:
    """A tuple of so many fields, each of its own kind, which `build` makes again."""
    names, coders = list(fields), list(fields.values())

    def pack(value: Any) -> Any:
        if len(_checked(kind, value)) != len(coders):
            raise Misfit(f"{len(coders)} values expected, not {len(value)}")
        return [named(*way) for way in zip(names, [c.pack for c in coders], value, strict=True)]

    def unpack(value: Any) -> Any:
        if len(_checked(list, value)) != len(coders):
            raise Misfit(f"{len(coders)} values expected, not {len(value)}")
        return build(*[named(*way) for way in zip(names, [c.unpack for c in coders], value, strict=True)])

    return Coder(pack, unpack)


def record(cls: Any, **replaced: Coder) -> Coder:
    """A NamedTuple by its annotations; `replaced`: the kinds of fields that these do not tell."""
    hints = get_type_hints(cls)
    fields = {name: replaced[name] if name in replaced else of(hints[name]) for name in cls._fields}
    return fixed(cls, cls, fields)


def message(schema: type[Message]) -> Coder:
    """A message, as it would travel by itself."""

    def unpack(value: Any) -> Any:
        try:
            return decode(_checked(bytes, value), schema)
        except Refused as refused:
            raise Misfit(refused.detail) from None

    return Coder(lambda value: encode(_checked(schema, value)), unpack)


def array(dtype: Any, shape: tuple[int | None, ...] | None = None) -> Coder:
    """An array of a shape; None: any, in the whole or along an axis."""
    expected = np.dtype(dtype).newbyteorder("<")

    def check(found: tuple[int, ...]) -> None:
        fits = shape is None or (len(found) == len(shape) and all(b in (None, a) for a, b in zip(found, shape, strict=True)))
        if not fits:
            raise Misfit(f"shape {shape} expected, not {found}")

    def pack(value: Any) -> Any:
        if _checked(np.ndarray, value).dtype != expected:
            raise Misfit(f"an array of {expected} expected, not of {value.dtype}")
        check(value.shape)
        # sums may run in the order of memory
        order = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
        return [list(value.shape), order, value.tobytes(order)]

    def unpack(value: Any) -> Any:
        if type(value) is not list or [type(part) for part in value] != [list, str, bytes] or value[1] not in ("C", "F"):
            raise Misfit("an array expected")
        found, order, content = value
        if not all(type(size) is int and size >= 0 for size in found):
            raise Misfit("a shape expected")
        check(tuple(found))
        if expected.kind == "b" and max(content, default=0) > 1:
            raise Misfit("neither true nor false")
        try:
            return np.frombuffer(content, expected).reshape(found, order=order).astype(dtype, order=order)
        except (ValueError, OverflowError):
            raise Misfit(f"{len(content)} bytes are no array of shape {found}") from None

    return Coder(pack, unpack)


def of(hint: Any) -> Coder:
    """The coder of a type annotation."""
    if hint in PLAIN:
        return PLAIN[hint]
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return either(*(of(each) for each in sorted(args, key=lambda each: each is not NoneType)))
    if origin is np.ndarray:
        return array(get_args(args[1])[0])
    if origin is frozenset:
        return a_set(of(args[0]))
    if origin is list or (origin is tuple and len(args) == 2 and args[1] is Ellipsis):
        return sequence(origin, of(args[0]))
    if origin is tuple:
        return fixed(lambda *values: values, tuple, {str(place): of(each) for place, each in enumerate(args)})
    if origin is dict and args[0] is str:
        item = of(args[1])
        return mapping(lambda key: item)  # noqa: ARG005
    if hasattr(hint, "_fields"):
        return record(hint)
    if isinstance(hint, type) and issubclass(hint, Message):
        return message(hint)
    raise Misfit(f"{hint} cannot be handed over")


PLAIN: dict[Any, Coder] = {int: INT, float: FLOAT, str: TEXT, bool: BOOL, NoneType: NONE, None: NONE}


def like(value: Any, first_axis: bool = False) -> Coder:
    """The coder of what began as `value`: its arrays keep their shape, with `first_axis` all but that of the first axis.

    What is None at first may become a number.
    """
    if value is None:
        return either(NONE, INT, FLOAT)
    if isinstance(value, np.ndarray):
        return array(value.dtype, (None, *value.shape[1:]) if first_axis else value.shape)
    if hasattr(value, "_fields"):
        hints = get_type_hints(type(value))
        own = {
            name: like(each, first_axis) if _holds_arrays(each) else of(hints[name])
            for name, each in zip(value._fields, value, strict=True)
        }
        return fixed(type(value), type(value), own)
    if type(value) is tuple:
        return fixed(lambda *values: values, tuple, {str(place): like(each, first_axis) for place, each in enumerate(value)})
    return of(type(value))


def _holds_arrays(value: Any) -> bool:
    return isinstance(value, np.ndarray) or (isinstance(value, tuple) and any(_holds_arrays(each) for each in value))
