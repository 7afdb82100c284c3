"""The [network] table: link models and their rules."""

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, WithJsonSchema, model_validator

from phalanx.network.delay import (
    ConstantDelay,
    DelayFloor,
    JitteredDelay,
    Rate,
    Reorder,
    Slot,
    UniformDelay,
)
from phalanx.network.link import DELAY, LOSS, TRACE, Kind
from phalanx.network.loss import (
    Bursts,
    Corrupt,
    DistanceLoss,
    Duplicate,
    RandomLoss,
)
from phalanx.network.presets import PRESETS, Preset
from phalanx.network.rule import Rule
from phalanx.network.trace import Trace
from phalanx.schema.fields import (
    BOUNDS,
    BURST,
    JITTER,
    NUMBER,
    Name,
    NonNegative,
    Positive,
    Probability,
    Strict,
    Table,
    built,
    field_error,
    number_or_table,
)
from phalanx.schema.json_schema import OfKind


def _alternative(**by_field: str) -> Callable[[Any], str]:
    """Make a discriminator that knows each alternative by a field that no other one has."""

    def tag_of(value: Any) -> str:
        if number_or_table(value) == NUMBER:
            return NUMBER
        # A date or a list fits no alternative: the error message of the first one says so.
        fields = value if isinstance(value, dict) else getattr(value, "__dict__", ())
        return next((tag for field, tag in by_field.items() if field in fields), default)

    default = next(iter(by_field.values()))
    return tag_of


Delay = Annotated[
    Annotated[NonNegative, Tag(NUMBER)]
    | Annotated[UniformDelay, Tag(BOUNDS)]
    | Annotated[JitteredDelay, Tag(JITTER)],
    Discriminator(_alternative(low=BOUNDS, time=JITTER, jitter=JITTER)),
]
Loss = Annotated[
    Annotated[Probability, Tag(NUMBER)] | Annotated[Bursts, Tag(BURST)],
    Discriminator(_alternative(mean=BURST)),
]


class LinkTable(Strict):
    """A link model in a scenario file, with netem's names and parameters."""

    preset: Preset | None = None
    """A link model by name; fields in the table replace the preset's."""
    delay: Delay = 0.0
    """Constant [s]; { low, high } for a uniform draw; or { time, jitter, correlation,
    distribution }, of uniform, normal, pareto and paretonormal."""
    delay_floor: DelayFloor | None = None
    """{ time, per_metre }: a least delay that grows with the distance."""
    loss: Loss = 0.0
    """Probability that a message is lost, independently of the others; or { mean, burst }."""
    loss_by_distance: DistanceLoss | None = None
    """{ none_within, all_beyond } [m], and linear between."""
    duplicate: Probability = 0.0
    """Probability of a second copy."""
    corrupt: Probability = 0.0
    """Probability of a flipped byte."""
    reorder: Reorder | None = None
    """{ probability, gap }: messages that are not delayed."""
    trace: Annotated[Trace, WithJsonSchema({"type": ["string", "object"]})] | None = None
    """Path of a CSV with delays that were measured: columns t and delay [s], empty if lost."""
    rate: Rate | None = None
    """{ bits_per_second, size, limit }: a queue."""
    slot: Positive | None = None
    """Delivery at the end of slots of this duration [s]."""
    rules: tuple[Annotated[Table, OfKind(Rule)], ...] = ()
    """Rules of your own, each { type = "package.module:Name", ... }, after all others."""

    @model_validator(mode="before")
    @classmethod
    def _from_preset(cls, table: Any) -> Any:
        name = table.get("preset") if isinstance(table, dict) else None
        preset = PRESETS.get(name) if isinstance(name, str) else None
        return {**preset, **table} if preset else table

    @model_validator(mode="after")
    def _built(self) -> Self:
        list(self.fields())
        return self

    def fields(self) -> Iterator[tuple[str, Rule]]:
        """Build the table's rules, with their fields, in the order in which they act."""
        if self.loss != 0.0:
            loss = self.loss
            yield LOSS, RandomLoss(loss) if isinstance(loss, float | int) else loss
        if self.loss_by_distance:
            yield "loss_by_distance", self.loss_by_distance
        if self.duplicate != 0.0:
            yield "duplicate", Duplicate(self.duplicate)
        if self.corrupt != 0.0:
            yield "corrupt", Corrupt(self.corrupt)
        if self.trace:
            yield TRACE, self.trace
        if self.rate:
            yield "rate", self.rate
        if self.delay != 0.0:
            delay = self.delay
            yield DELAY, ConstantDelay(delay) if isinstance(delay, float | int) else delay
        if self.reorder:
            yield "reorder", self.reorder
        if self.delay_floor:
            yield "delay_floor", self.delay_floor
        if self.slot:
            yield "slot", Slot(self.slot)
        for index, table in enumerate(self.rules):
            yield f"rules.{index}", built(f"rules.{index}", Rule, table)


class SomeLinks(Strict):
    """A set of links. A link within a robot has the robot's name at both ends."""

    of: Kind = "broadcast"
    """The messages of the links."""
    sender: Name | Literal["*"] = Field(default="*", alias="from")
    receiver: Name | Literal["*"] = Field(default="*", alias="to")

    def concerns(self, sender: str, receiver: str, of: Kind) -> bool:
        """Return whether a link is one of the set."""
        return self.of == of and self.sender in ("*", sender) and self.receiver in ("*", receiver)

    def check_names(self, names: list[str], where: tuple[str | int, ...]) -> None:
        """Raise ValidationError for an unknown name."""
        for field, name in (("from", self.sender), ("to", self.receiver)):
            if name != "*" and name not in names:
                message = f"expected an agent's name or '*', one of {names}"
                raise field_error((*where, field), message, name)


class LinkOverride(SomeLinks, LinkTable):
    """A link model for some links; if several match a link, the last one applies."""

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        if self.of == "sample":
            require_in_time(self, ())
        return self


class Network(LinkTable):
    """The link models: of all agent-to-agent links, of links within robots, and of single links."""

    sample: LinkTable = LinkTable()
    """Links from each robot's sensors: the agent skips a sample that is lost."""
    actuation: LinkTable = LinkTable()
    """Links to each robot's actuators: they hold their input until the next one arrives."""
    links: tuple[LinkOverride, ...] = ()

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        require_in_time(self.sample, ("sample",))
        return self


def require_in_time(table: LinkTable, where: tuple[str, ...]) -> None:
    """Raise ValidationError if a table of links for samples delays them."""
    for field, _ in table.fields():
        if field not in (LOSS, "corrupt") and not field.startswith("rules"):
            message = "expected loss and corrupt alone: for delayed samples use time.latency"
            raise field_error((*where, field), message, getattr(table, field))
