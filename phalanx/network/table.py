"""The [network] table: what happens to messages on each link."""

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from phalanx.network.delay import (
    ConstantDelay,
    DelayFloor,
    JitteredDelay,
    Rate,
    Reorder,
    Slot,
    UniformDelay,
)
from phalanx.network.link import DELAY, LOSS, Kind
from phalanx.network.loss import (
    Chance,
    Corrupt,
    DistanceLoss,
    Duplicate,
    GilbertElliott,
    RandomLoss,
    bursts,
)
from phalanx.network.presets import PRESETS, Preset
from phalanx.network.rule import Rule, UsersRule
from phalanx.schema.fields import (
    BOUNDS,
    BURST,
    CHANCE,
    GEMODEL,
    JITTER,
    NUMBER,
    Name,
    NonNegative,
    Positive,
    Probability,
    Strict,
    Table,
    built,
    misplaced,
    number_or_table,
)


class GilbertElliottTable(Strict):
    """netem's `loss gemodel`: { p, r, 1-h, 1-k }."""

    p: Probability
    r: Probability | None = None
    """If left out, 1 - p: losses that do not know of one another."""
    lost_if_bad: Probability = Field(default=1.0, alias="1-h")
    lost_if_good: Probability = Field(default=0.0, alias="1-k")

    def rule(self) -> GilbertElliott:
        """The rule that the table describes."""
        r = 1.0 - self.p if self.r is None else self.r
        return GilbertElliott(self.p, r, self.lost_if_bad, self.lost_if_good)


class BurstTable(Strict):
    """Gilbert's model as one sees it: { mean, burst }."""

    mean: Annotated[Probability, Field(lt=1)]
    """Share of messages lost."""
    burst: Annotated[float, Field(ge=1)]
    """Mean number of messages lost in a row."""

    def rule(self) -> GilbertElliott:
        """The rule that the table describes. Raises ValueError."""
        return bursts(self.mean, self.burst)

    @model_validator(mode="after")
    def _exists(self) -> Self:
        self.rule()
        return self


class RandomTable(Strict):
    """netem's `loss random`: { random, correlation }."""

    random: Probability
    correlation: Annotated[Probability, Field(lt=1)] = 0.0

    def rule(self) -> RandomLoss:
        """The rule that the table describes."""
        return RandomLoss(Chance(self.random, self.correlation))


def _alternative(**by_field: str) -> Callable[[Any], str]:
    """Which alternative a value is meant as: by a field that only it has, the first if none."""

    def which(value: Any) -> str:
        if number_or_table(value) == NUMBER:
            return NUMBER
        # A date or a list is none of them, which the first that is tried says in words.
        named = value if isinstance(value, dict) else getattr(value, "__dict__", ())
        return next((tag for field, tag in by_field.items() if field in named), default)

    default = next(iter(by_field.values()))
    return which


Delay = Annotated[
    Annotated[NonNegative, Tag(NUMBER)]
    | Annotated[UniformDelay, Tag(BOUNDS)]
    | Annotated[JitteredDelay, Tag(JITTER)],
    Discriminator(_alternative(low=BOUNDS, time=JITTER, jitter=JITTER)),
]
Loss = Annotated[
    Annotated[Probability, Tag(NUMBER)]
    | Annotated[RandomTable, Tag(CHANCE)]
    | Annotated[BurstTable, Tag(BURST)]
    | Annotated[GilbertElliottTable, Tag(GEMODEL)],
    Discriminator(_alternative(random=CHANCE, mean=BURST, burst=BURST, p=GEMODEL, r=GEMODEL)),
]
ChanceField = Annotated[
    Annotated[Probability, Tag(NUMBER)] | Annotated[Chance, Tag(CHANCE)],
    Discriminator(_alternative(probability=CHANCE)),
]


class LinkTable(Strict):
    """A link model as a scenario writes it: names and parameters are netem's."""

    preset: Preset | None = None
    """A link model by name; fields that are given replace the preset's."""
    delay: Delay = 0.0
    """Constant [s]; { low, high } for a uniform draw; or { time, jitter, correlation,
    distribution }, of uniform, normal, pareto and paretonormal."""
    delay_floor: DelayFloor | None = None
    """{ time, per_metre }: the least that a message takes, by distance."""
    loss: Loss = 0.0
    """Probability that a message is lost, independently of the others; { random, correlation };
    { mean, burst }; or { p, r, 1-h, 1-k }."""
    loss_by_distance: DistanceLoss | None = None
    """{ none_within, all_beyond } [m], and linear between."""
    duplicate: ChanceField = 0.0
    """Probability of a second copy, or { probability, correlation }."""
    corrupt: ChanceField = 0.0
    """Probability of a flipped byte, or { probability, correlation }."""
    reorder: Reorder | None = None
    """{ probability, correlation, gap }: what is not delayed."""
    rate: Rate | None = None
    """{ bits_per_second, size, limit }: messages wait for one another."""
    slot: Positive | None = None
    """Delivery at the end of slots as long as this [s]."""
    rules: tuple[Table, ...] = ()
    """Rules of your own, each { type = "package.module:Name", ... }, after all others."""

    @model_validator(mode="before")
    @classmethod
    def _from_preset(cls, table: Any) -> Any:
        name = table.get("preset") if isinstance(table, dict) else None
        known = PRESETS.get(name) if isinstance(name, str) else None
        return {**known.table, **table} if known else table

    @model_validator(mode="after")
    def _built(self) -> Self:
        list(self.fields())
        return self

    def fields(self) -> Iterator[tuple[str, Rule]]:
        """The rules that the table asks for, by field, in the order in which they act."""
        if self.loss != 0.0:
            yield LOSS, _loss(self.loss)
        if self.loss_by_distance:
            yield "loss_by_distance", self.loss_by_distance
        if self.duplicate != 0.0:
            yield "duplicate", Duplicate(_chance(self.duplicate))
        if self.corrupt != 0.0:
            yield "corrupt", Corrupt(_chance(self.corrupt))
        if self.rate:
            yield "rate", self.rate
        if self.delay != 0.0:
            yield DELAY, _delay(self.delay)
        if self.reorder:
            yield "reorder", self.reorder
        if self.delay_floor:
            yield "delay_floor", self.delay_floor
        if self.slot:
            yield "slot", Slot(self.slot)
        for place, table in enumerate(self.rules):
            yield f"rules.{place}", UsersRule(built(f"rules.{place}", Rule, table))


def _loss(loss: "float | RandomTable | BurstTable | GilbertElliottTable") -> Rule:
    return RandomLoss(Chance(loss)) if isinstance(loss, float | int) else loss.rule()


def _delay(delay: "float | UniformDelay | JitteredDelay") -> Rule:
    return ConstantDelay(delay) if isinstance(delay, float | int) else delay


def _chance(chance: float | Chance) -> Chance:
    return Chance(chance) if isinstance(chance, float | int) else chance


class SomeLinks(Strict):
    """Which links something is about. Both ends of a robot's own links are called like it."""

    of: Kind = "broadcast"
    """The cargo of the links."""
    sender: Name | Literal["*"] = Field(default="*", alias="from")
    receiver: Name | Literal["*"] = Field(default="*", alias="to")

    def concerns(self, sender: str, receiver: str, of: Kind) -> bool:
        """Whether it is about this link."""
        return self.of == of and self.sender in ("*", sender) and self.receiver in ("*", receiver)

    def check_names(self, names: list[str], where: tuple[str | int, ...]) -> None:
        """Raise ValidationError for a name that nobody has."""
        for field, name in (("from", self.sender), ("to", self.receiver)):
            if name != "*" and name not in names:
                message = f"expected an agent's name or '*', one of {names}"
                raise misplaced((*where, field), message, name)


class LinkOverride(SomeLinks, LinkTable):
    """A link model for some links only; of several that match, the last counts."""

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        if self.of == "sample":
            require_in_time(self, ())
        return self


class Network(LinkTable):
    """The model of every agent-to-agent link, those within the robots, and exceptions to them."""

    sample: LinkTable = LinkTable()
    """From each robot's sensors: a sample that is lost is missed."""
    actuation: LinkTable = LinkTable()
    """To each robot's actuators: they hold what they have until another input comes."""
    links: tuple[LinkOverride, ...] = ()

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        require_in_time(self.sample, ("sample",))
        return self


def require_in_time(table: LinkTable, where: tuple[str, ...]) -> None:
    """Raise ValidationError if a table for samples delays them."""
    for field, _ in table.fields():
        if field not in (LOSS, "corrupt") and not field.startswith("rules"):
            message = "expected loss and corrupt alone: samples are not late, see time.latency"
            raise misplaced((*where, field), message, getattr(table, field))
