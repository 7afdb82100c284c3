"""The [safety] table: the safe set and the controller's options."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, PrivateAttr, Tag, field_validator, model_validator

from phalanx.schema.built_in import BUILT_IN
from phalanx.schema.fields import (
    NUMBER,
    TABLE,
    WORD,
    Finite,
    NonNegative,
    Positive,
    Strict,
    Table,
    Unquoted,
    built,
    field_error,
    number_or_table,
)
from phalanx.schema.json_schema import OfKind, one_of
from phalanx.schema.registry import is_users, lookup
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx.theory.margins.margin import Margin, MarginConstants
from phalanx.theory.rows.information import Information, Together
from phalanx.theory.safety.class_k import ClassK, Linear, require_class_k
from phalanx.theory.safety.function import HeadingAware, SafeSetFunction

Composition = Literal["lse", "pairs"]
ClassKField = Annotated[
    Annotated[Positive, Tag(NUMBER)] | Annotated[Table, OfKind(ClassK), Tag(TABLE)],
    Discriminator(number_or_table),
]
MarginField = Annotated[
    Annotated[str, one_of(Margin), Tag(WORD)] | Annotated[Table, OfKind(Margin), Tag(TABLE)],
    Discriminator(lambda value: TABLE if isinstance(value, dict) else WORD),
]


class Exit(Strict):
    """The fallback to leave."""

    exit: Annotated[tuple[Finite, ...], Field(min_length=2, max_length=3)]
    """The velocity that all normal agents share [m/s]."""

    @field_validator("exit")
    @classmethod
    def _moves(cls, velocity: tuple[float, ...]) -> tuple[float, ...]:
        if not any(velocity):
            raise ValueError("expected a velocity, got zeros only: keep = 'hold' stands")
        return velocity


KeepField = Annotated[
    Annotated[Literal["hold", "flight"], Tag(WORD)] | Annotated[Exit, Tag(TABLE)],
    Discriminator(lambda value: TABLE if isinstance(value, dict | Exit) else WORD),
]


class Safety(Strict):
    """The safe set and the controller's options."""

    function: Annotated[Table, OfKind(SafeSetFunction)]
    """h of pairs, for example { type = "separation", radius = 1.0 }."""
    rho: Positive
    """ρ of LSE."""
    alpha: Annotated[tuple[ClassKField, ...], Field(min_length=1)]
    """α_1, ..., α_q: the gain of a linear one [1/s], or { type = "power", gain, exponent }."""
    control: Literal["distributed", "centralised"] = "distributed"
    """One QP per agent, or one controller with the QP of Theorem 1, which needs synchronous
    clocks."""
    composition: Composition = "pairs"
    """One row for each pair, or one row for h_tot = LSE of all pairs, as in the paper."""
    margin: MarginField = "paper"
    """The margin η: paper; or for one row for each pair corrected, with L_φ ψ_k for every k >= 1,
    or a bound computed at each sample, without eta and xi: local, or the smaller integrated for a
    linear α_q. Or a user's own for one row for each pair, { type = "package.module:Name", ... }."""
    eta: Annotated[
        Annotated[NonNegative, Tag(NUMBER)] | Annotated[MarginConstants, Tag(TABLE)],
        Discriminator(number_or_table),
    ] = 0.0
    """The margin η as a number, or the constants of Lemma (constants) to compute it from."""
    xi: NonNegative = 0.0
    """ξ of Eq. (xi); used if q > 1 and the margin is paper or corrected."""
    information: Annotated[str, one_of(Information)] = "split"
    """Assumption about the other normal agents' inputs."""
    silence: Positive = 1.0
    """A normal agent without a received broadcast for longer counts as an adversary [s]."""
    neighbourhood: Positive | None = None
    """Sensing radius of normal agents whose group has none [m]: an agent composes the pairs that
    it sees. Default: no limit. A centralised controller sees everything."""
    watch: bool = False
    """Whether agents hold the inputs that others announce against where these go, and convict those
    that no disturbance within its bound explains."""
    prove: bool = False
    """Whether agents evaluate their own certificates for an input before they apply it, and look
    for a better one if it is proven safe for less than until the next sample."""
    keep: KeepField | None = None
    """The fallback that agents always keep, so that pairs can be promised: hold, to stop and keep a
    place; { exit = [vx, vy] }, to move on for ever with one velocity that all share [m/s]; flight,
    of a lone unicycle, to turn and drive straight on or back for ever."""

    _function: SafeSetFunction = PrivateAttr()
    _alpha: tuple[ClassK, ...] = PrivateAttr()

    @field_validator("margin", mode="before")
    @classmethod
    def _by_name(cls, given: Any) -> Any:
        """Write { type = "local" } as "local"."""
        only_named = isinstance(given, dict) and list(given) == ["type"] and not is_users(given)
        return given["type"] if only_named else given

    @field_validator("information")
    @classmethod
    def _model(cls, name: str) -> str:
        if name not in BUILT_IN[Information]:
            raise ValueError(f"expected {', '.join(map(repr, BUILT_IN[Information]))}")
        return name

    @model_validator(mode="after")
    def _resolve(self) -> Self:
        if self.control == "centralised" and self.composition == "pairs":
            message = "expected 'lse' where safety.control is 'centralised'"
            raise field_error(("composition",), message, self.composition)
        if self.control == "centralised" and self.prove:
            message = "expected false: a centralised controller proves no inputs"
            raise field_error(("prove",), message, self.prove)
        if self.control == "centralised" and self.keep:
            message = "expected none: each agent keeps a fallback of its own"
            raise field_error(("keep",), message, self.keep)
        if self.control == "centralised" and not self._named.reads_roles:
            message = "expected another: a centralised controller knows whom it controls"
            raise field_error(("information",), message, self.information)
        self.margin_kind  # noqa: B018 - its mistakes are said here
        if self.computes_margin and self.eta:
            message = f"expected no value, or 0: margin = '{self.margin_name}' computes it"
            raise field_error(("eta",), message, self.eta)
        if not self.computes_margin and "eta" not in self.model_fields_set:
            raise field_error(
                ("eta",), "expected a value, or margin = 'local' or 'integrated'", None
            )
        if self.margin_name != "paper" and not self.pairwise:
            message = "expected 'paper', or composition = 'pairs': see docs/retired.md"
            raise field_error(("margin",), message, self.margin)
        if self.information_model.shares and not (self.pairwise or self.centralised):
            message = "expected another, or composition = 'pairs': see docs/retired.md"
            raise field_error(("information",), message, self.information)
        self._function = built("function", SafeSetFunction, self.function)
        if isinstance(self._function, HeadingAware) and not self._named.reads_roles:
            message = "expected another: h of 'heading-aware' depends on declared roles"
            raise field_error(("information",), message, self.information)
        self._alpha = tuple(_class_k(place, given) for place, given in enumerate(self.alpha))
        if self.limits_alpha and not isinstance(self._alpha[-1], Linear):
            message = "expected a number, or another margin: 'integrated' needs a linear α_q"
            raise field_error(("alpha", len(self.alpha) - 1), message, self.alpha[-1])
        return self

    # Properties that follow from the options. Other rooms use these, not the options' values.

    @property
    def pairwise(self) -> bool:
        """True for one row for each of an agent's pairs, False for one row for h_tot."""
        return self.composition == "pairs"

    @property
    def centralised(self) -> bool:
        """True if one controller computes the inputs of all normal agents."""
        return self.control == "centralised"

    @property
    def information_model(self) -> type[Information]:
        """Assumptions of rows on the other normal agents' inputs."""
        return Together if self.centralised else self._named

    @property
    def modes(self) -> frozenset[str]:
        """The parts of agents that are on, by their fields."""
        return frozenset(field for field in ("keep", "prove", "watch") if getattr(self, field))

    @property
    def committed(self) -> bool:
        """True if agents apply an input only if a fallback remains after it."""
        return self.keep is not None

    @property
    def exit_velocity(self) -> tuple[float, ...] | None:
        """The velocity with which agents leave as their fallback [m/s]; None if they stop."""
        return self.keep.exit if isinstance(self.keep, Exit) else None

    @property
    def flees(self) -> bool:
        """True if the fallback is a lone unicycle's flight."""
        return self.keep == "flight"

    @property
    def leaves(self) -> bool:
        """True if the fallback is to leave: slower ones are then promised for ever."""
        return self.flees or self.exit_velocity is not None

    def build_information(self, unchanged: Mapping[int, float]) -> Information:
        """Build the information model; unchanged: Γ_l - δ_l^max of each normal agent [s]."""
        return self.information_model(unchanged, self.silence)

    def sensing(self, sensor: float | None) -> float | None:
        """Return how far a normal agent with this sensor sees [m]; None without a limit."""
        return None if self.centralised else sensor or self.neighbourhood

    @property
    def _named(self) -> type[Information]:
        return lookup(Information, self.information)

    @property
    def lacking_for_proof(self) -> list[str]:
        """Fields to set for rows that are proven, such as "margin = 'integrated'"."""
        proven = {"control": "distributed", "composition": "pairs", "margin": "integrated"}
        if self._named.reads_roles:
            proven["information"] = "split"
        fields = [f"{k} = '{v}'" for k, v in proven.items() if getattr(self, k) != v]
        return fields + ([] if self.computes_margin else ["eta = 0"])

    def eta_at(self, gap: float, disturbances: float) -> float:
        """η, given or from constants; arguments as MarginConstants.eta has them."""
        eta = self.eta
        return eta.eta(gap, disturbances) if isinstance(eta, MarginConstants) else eta

    @property
    def margin_name(self) -> str:
        """The built-in name of the margin, or "package.module:Name"."""
        return self.margin if isinstance(self.margin, str) else str(self.margin.get("type"))

    @property
    def margin_kind(self) -> Margin:
        """The margin of a pair's row that the field describes."""
        table = {"type": self.margin} if isinstance(self.margin, str) else self.margin
        made: Margin = built("margin", Margin, table)
        return made

    @property
    def own_margin(self) -> bool:
        """True if the margin is a user's own, of which nothing is proven."""
        return is_users({"type": self.margin_name})

    @property
    def computes_margin(self) -> bool:
        """True if the margin is computed at each sample, not a given number."""
        return self.bounds_margin or self.own_margin

    @property
    def bounds_margin(self) -> bool:
        """True if the margin is a proven bound, computed at each sample."""
        return self.margin_name in ("local", "integrated")

    @property
    def limits_alpha(self) -> bool:
        """True if the margin is proven only up to a certain gain of α_q."""
        return self.margin_name == "integrated"

    @property
    def counts_disturbance(self) -> bool:
        """True if ψ_2 and later ones include the disturbance, which the paper leaves out."""
        return self.margin_name != "paper"

    @property
    def xi_of_chain(self) -> float | None:
        """ξ in ψ_1; None if its value at each state is used instead."""
        return None if self.computes_margin else self.xi

    @property
    def safe_set_function(self) -> SafeSetFunction:
        """The function that the table `function` describes."""
        return self._function

    @property
    def class_k(self) -> tuple[ClassK, ...]:
        """α_1, ..., α_q as functions."""
        return self._alpha


def _class_k(place: int, given: float | Table) -> ClassK:
    """Build one α; a function that is not class K is an error of its field."""
    if not isinstance(given, dict):
        return Linear(given)
    alpha: ClassK = built("alpha", ClassK, given)
    try:
        require_class_k(alpha)
    except MistakenMethodError as error:
        raise field_error(("alpha", place), error.expected, Unquoted(error.got)) from error
    return alpha
