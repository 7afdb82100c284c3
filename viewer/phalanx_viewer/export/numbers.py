"""Protobuf messages of named numbers, made while one exports, which any tool can plot."""

import re
from collections.abc import Iterable, Mapping, Sequence

from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass


class Numbers:
    """One kind of message: a field for each name, and perhaps some of text."""

    def __init__(self, kind: str, names: Sequence[str], texts: Sequence[str] = ()) -> None:
        """kind: the message's name, without a package."""
        self.fields = dict(zip(names, identifiers(names), strict=True))
        """The field's name by what it holds."""
        file = FileDescriptorProto(name=f"phalanx/{kind}.proto", package="phalanx")
        message = file.message_type.add(name=kind)
        number, text = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_STRING
        fields = [*((name, number) for name in self.fields.values()), *((t, text) for t in texts)]
        for place, (name, type_) in enumerate(fields, start=1):
            # Optional, as proto2 has it: a number that is not there is not 0.
            label = FieldDescriptorProto.LABEL_OPTIONAL
            message.field.add(name=name, number=place, type=type_, label=label)
        pool = DescriptorPool()
        pool.Add(file)
        self._make = GetMessageClass(pool.FindMessageTypeByName(f"phalanx.{kind}"))
        self._names = tuple(self.fields.values())

    def by_field(self, units: Mapping[str, str]) -> dict[str, str]:
        """Units by field instead of by name; none where they are not known."""
        return {self.fields[name]: unit for name, unit in units.items() if unit}

    def __call__(self, values: Iterable[float | None], **texts: str) -> Message:
        """A message of numbers in the order of the names; None is left out."""
        given = {n: v for n, v in zip(self._names, values, strict=True) if v is not None}
        return self._make(**given, **texts)


def identifiers(names: Sequence[str]) -> list[str]:
    """Names that protobuf takes, all different: letters, digits and underscores."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = plain if re.match(r"[A-Za-z]", plain) else f"n_{plain}"
        again = sum(re.fullmatch(rf"{plain}(_\d+)?", other) is not None for other in found)
        found.append(f"{plain}_{again + 1}" if plain in found else plain)
    return found
