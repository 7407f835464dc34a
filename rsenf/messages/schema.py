"""Derives Protobuf schemas from message classes, and converts messages to and from Protobuf.

A message is a frozen dataclass whose fields carry their number, unit and shape. From it this
module derives, once, two Protobuf descriptors of the *same wire format*:

* the published one, in which an array is ``repeated float x``, embedded in every recording, and
  as a ``.proto`` file with units and descriptions (:func:`file_text`);
* its private twin, in which the array is ``bytes x``: packed fixed-width numbers and a byte
  string are identical on the wire, and NumPy fills the second eighty times faster.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import threading
import types
import typing
from collections.abc import Callable
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import SchemaMismatch

PACKAGE = "rsenf"
PROTO_FILE = "rsenf.proto"

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Int64Array = NDArray[np.int64]
UInt32Array = NDArray[np.uint32]

# Wire type of an array -> its element type: little-endian and of fixed width, so that the packed
# form equals the memory of the array.
_ARRAYS = {"float": "<f4", "double": "<f8", "sfixed64": "<i8", "fixed32": "<u4"}
_SCALARS = {int: "int64", float: "double", str: "string", bytes: "bytes", bool: "bool"}

M = TypeVar("M")
_registry: dict[str, type[Any]] = {}
_building = threading.Lock()
_specs: dict[type[Any], tuple[FieldSpec, ...]] = {}
_plans: dict[type[Any], _Plan] = {}
_twins: dict[type[Any], Any] = {}


def field(
    number: int, doc: str, default: Any = None, *, wire: str = "", shape: tuple[str, ...] = ()
) -> Any:
    """Declare a field of a message.

    Parameters
    ----------
    number : int
        Protobuf field number; never reused once published.
    doc : str
        Description for the published schema.
    default : object, optional
        Default value; arrays are empty by default.
    wire : str, optional
        Protobuf type, if it doesn't follow from the annotation.
    shape : tuple of str, optional
        For an array: the fields that hold its dimensions.
    """
    meta = {"number": number, "doc": doc, "wire": wire, "shape": shape}
    if wire in _ARRAYS:
        return dataclasses.field(
            default_factory=functools.partial(np.empty, (0,) * max(len(shape), 1), _ARRAYS[wire]),
            metadata=meta,
        )
    return dataclasses.field(default=default, metadata=meta)


def message(number: int, *, version: int) -> Callable[[type[M]], type[M]]:
    """Register a dataclass as a message.

    Parameters
    ----------
    number : int
        Its place in the published schema, which recordings embed: a new message comes last.
    version : int
        Of its schema.
    """

    def register(cls: type[M]) -> type[M]:
        _registry[cls.__name__] = cls
        cls.NUMBER, cls.VERSION = number, version  # type: ignore[attr-defined]  # as type[Any]
        return cls

    return register


def message_classes() -> dict[str, type[Any]]:
    """Return all message classes by their unqualified names, in the order of their numbers."""
    return dict(sorted(_registry.items(), key=lambda item: item[1].NUMBER))


@dataclasses.dataclass(frozen=True)
class FieldSpec:
    """Protobuf description of one field."""

    name: str
    number: int
    doc: str
    wire: str  # a Protobuf scalar type, or the name of another message
    kind: str  # "scalar", "array", "message", "repeated"
    shape: tuple[str, ...]


def field_specs(cls: type[Any]) -> tuple[FieldSpec, ...]:
    """Return the wire fields of a message class."""
    specs = _specs.get(cls)
    if specs is None:
        hints = typing.get_type_hints(cls)
        # A field without metadata isn't serialised (a frame's luma plane).
        specs = tuple(_spec(f, hints[f.name]) for f in dataclasses.fields(cls) if f.metadata)
        _specs[cls] = specs
    return specs


def _spec(f: dataclasses.Field[Any], hint: Any) -> FieldSpec:
    meta, wire, kind = f.metadata, f.metadata["wire"], "scalar"
    if wire in _ARRAYS:
        kind = "array"
    elif typing.get_origin(hint) is tuple:
        kind, inner = "repeated", typing.get_args(hint)[0]
        wire = _SCALARS.get(inner, inner.__name__)
    elif not wire:
        inner = _without_none(hint)
        kind = "scalar" if inner in _SCALARS else "message"
        wire = _SCALARS.get(inner, inner.__name__)
    return FieldSpec(f.name, meta["number"], meta["doc"], wire, kind, meta["shape"])


def _without_none(hint: Any) -> Any:
    if isinstance(hint, types.UnionType):
        return next(a for a in typing.get_args(hint) if a is not type(None))
    return hint


def file_descriptor(*, twin: bool = False) -> Any:
    """Describe all messages as a ``FileDescriptorProto``: the published form, or its fast twin."""
    from google.protobuf import descriptor_pb2

    out = descriptor_pb2.FileDescriptorProto(
        name=("twin_" if twin else "") + PROTO_FILE,
        package=PACKAGE + (".twin" if twin else ""),
        syntax="proto3",
    )
    kinds = descriptor_pb2.FieldDescriptorProto
    for cls in message_classes().values():
        described = out.message_type.add(name=cls.__name__)
        for spec in field_specs(cls):
            wire = "bytes" if twin and spec.kind == "array" else spec.wire
            many = spec.kind == "repeated" or (spec.kind == "array" and not twin)
            made = described.field.add(
                name=spec.name,
                number=spec.number,
                label=kinds.LABEL_REPEATED if many else kinds.LABEL_OPTIONAL,
            )
            if wire in _registry:
                made.type, made.type_name = kinds.TYPE_MESSAGE, f".{out.package}.{wire}"
            else:
                made.type = getattr(kinds, f"TYPE_{wire.upper()}")
    return out


@functools.cache
def _twin_classes() -> dict[str, Any]:
    """Build all twin classes from one descriptor pool: those of two pools are incompatible."""
    from google.protobuf import descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(file_descriptor(twin=True).SerializeToString())
    package = PACKAGE + ".twin"
    return {
        name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{package}.{name}"))
        for name in _registry
    }


def twin_class(cls: type[Any]) -> Any:
    """Return the Protobuf class of a message class's fast twin."""
    twin = _twins.get(cls)
    if twin is None:
        with _building:  # functools.cache alone lets two threads build two sets
            twin = _twins[cls] = _twin_classes()[cls.__name__]
    return twin


class _Plan(typing.NamedTuple):
    """Fields that are copied unchanged, a function that reads all of them, and the other fields."""

    names: tuple[str, ...]
    read: Callable[[Any], tuple[Any, ...]]
    others: tuple[FieldSpec, ...]


def _plan(cls: type[Any]) -> _Plan:
    plan = _plans.get(cls)
    if plan is None:
        specs = field_specs(cls)
        names = tuple(spec.name for spec in specs if spec.kind == "scalar")
        others = tuple(spec for spec in specs if spec.kind != "scalar")
        plan = _plans[cls] = _Plan(names, _reader(names), others)
    return plan


def _reader(names: tuple[str, ...]) -> Callable[[Any], tuple[Any, ...]]:
    """Return a function that reads fields at once, in half the time of one after the other."""
    if len(names) < 2:  # attrgetter of one name returns no tuple
        return lambda message: tuple(getattr(message, name) for name in names)
    return attrgetter(*names)


def to_wire(msg: Any) -> Any:
    """Convert a message to its Protobuf twin, ready to serialise."""
    plan = _plan(type(msg))
    values: dict[str, Any] = dict(zip(plan.names, plan.read(msg), strict=True))
    for spec in plan.others:
        value = getattr(msg, spec.name)
        if spec.kind == "array":
            value = _array_bytes(msg, spec, value)
        elif spec.kind == "message":
            value = None if value is None else to_wire(value)
        elif spec.wire in _registry:
            value = [to_wire(v) for v in value]
        values[spec.name] = value
    return twin_class(type(msg))(**values)


def _array_bytes(msg: Any, spec: FieldSpec, value: NDArray[Any]) -> bytes:
    dims = tuple(getattr(msg, name) for name in spec.shape)
    if value.size and dims and value.shape != dims:
        raise ValueError(f"{type(msg).__name__}.{spec.name}: shape {value.shape}, not {dims}")
    return np.ascontiguousarray(value, _ARRAYS[spec.wire]).tobytes()


def from_wire(cls: type[M], wire: Any) -> M:
    """Convert a parsed Protobuf twin to the message, checking each array against its shape.

    Raises
    ------
    SchemaMismatch
        When an array's length isn't the product of its dimensions.
    """
    plan = _plan(cls)
    values: dict[str, Any] = dict(zip(plan.names, plan.read(wire), strict=True))
    for spec in plan.others:
        value = getattr(wire, spec.name)
        if spec.kind == "array":
            value = _shaped(cls, wire, spec, value)
        elif spec.kind == "message":
            nested = _registry[spec.wire]
            value = from_wire(nested, value) if wire.HasField(spec.name) else None
        else:
            nested_cls = _registry.get(spec.wire)
            value = tuple(from_wire(nested_cls, v) if nested_cls else v for v in value)
        values[spec.name] = value
    return cls(**values)


def _shaped(cls: type[Any], wire: Any, spec: FieldSpec, raw: bytes) -> NDArray[Any]:
    dtype = np.dtype(_ARRAYS[spec.wire])
    dims = tuple(int(getattr(wire, name)) for name in spec.shape)
    if not raw:
        return np.empty((0,) * max(len(dims), 1), dtype)
    if not dims and len(raw) % dtype.itemsize == 0:
        return np.frombuffer(raw, dtype)
    if min(dims, default=0) < 0 or math.prod(dims) * dtype.itemsize != len(raw):
        raise SchemaMismatch(f"{cls.__name__}.{spec.name}: {len(raw)} bytes don't fill {dims}")
    return np.frombuffer(raw, dtype).reshape(dims)


_HEAD = f"""\
// Generated by 'rsenf explain schemas' from rsenf/messages. Do not edit.
//
// NaN is an unknown number, 0 an unknown wall-clock time. Arrays are packed, row by row; the
// comment of each names its dimensions.
syntax = "proto3";
package {PACKAGE};
"""


def message_text(cls: type[Any]) -> str:
    """Return one message as Protobuf source."""
    doc = inspect.cleandoc(cls.__doc__ or "")
    lines = [f"// {line}".rstrip() for line in doc.splitlines()]
    lines += [f"// Schema version {cls.VERSION}.", f"message {cls.__name__} {{"]
    lines += [f"  {_field(spec)}" for spec in field_specs(cls)]
    return "\n".join([*lines, "}"])


def _field(spec: FieldSpec) -> str:
    label = "repeated " if spec.kind in ("array", "repeated") else ""
    shape = f" [{' × '.join(spec.shape)}]" if spec.shape else ""
    comment = f"  // {spec.doc}{shape}" if spec.doc or shape else ""
    return f"{label}{spec.wire} {spec.name} = {spec.number};{comment}"


def file_text() -> str:
    """Return the whole schema as Protobuf source."""
    return "\n\n".join([_HEAD, *map(message_text, message_classes().values())]) + "\n"
