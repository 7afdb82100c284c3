"""The [safety] table: the safe set and the controller's choices."""

from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, PrivateAttr, Tag, model_validator

from phalanx.schema.fields import (
    NUMBER,
    TABLE,
    InWords,
    NonNegative,
    Positive,
    Strict,
    Table,
    built,
    misplaced,
    number_or_table,
)
from phalanx.theory.expressions.asked import place_of
from phalanx.theory.margins.constants import MarginConstants
from phalanx.theory.margins.margin import MarginKind
from phalanx.theory.rows.information import Information
from phalanx.theory.safety.class_k import ClassK, Linear, NotClassKError, require_class_k
from phalanx.theory.safety.function import SafeSetFunction

Composition = Literal["lse", "pairs"]
ClassKField = Annotated[
    Annotated[Positive, Tag(NUMBER)] | Annotated[Table, Tag(TABLE)],
    Discriminator(number_or_table),
]


class Safety(Strict):
    """The safe set and the controller's choices."""

    function: Table
    """h of pairs, for example { type = "separation", radius = 1.0 }."""
    rho: Positive
    """ρ of LSE."""
    alpha: Annotated[tuple[ClassKField, ...], Field(min_length=1)]
    """α_1, ..., α_q: the gain of a linear one [1/s], or { type = "power", gain, exponent }."""
    control: Literal["distributed", "centralised"] = "distributed"
    """Each agent its own QP, or one controller the QP of Theorem 1, which needs synchronous
    clocks."""
    composition: Composition = "lse"
    """One row for h_tot = LSE of all pairs, as in the paper, or one row for each pair."""
    margin: MarginKind = "paper"
    """How η is made: as in the paper; corrected, with L_φ ψ_k for every k >= 1; or a bound computed
    at each sample, which needs neither eta nor xi: local, of any row, or the smaller integrated, of
    one row for each pair with a linear α_q."""
    margin_scale: Positive = 1.0
    """What the margin is multiplied with; below 1 nothing is proven."""
    eta: Annotated[
        Annotated[NonNegative, Tag(NUMBER)] | Annotated[MarginConstants, Tag(TABLE)],
        Discriminator(number_or_table),
    ] = 0.0
    """The margin η: a number as given, or the constants of Lemma (constants) to compute it."""
    xi: NonNegative = 0.0
    """ξ of Eq. (xi); used when q > 1 and the margin is neither local nor integrated."""
    information: Information = Information.PAPER
    """What an agent assumes of the other normal agents' inputs."""
    silence: Positive = 1.0
    """A normal agent not heard of for longer counts at γ_l^max, like an adversary [s]."""
    neighbourhood: Positive | None = None
    """How far normal agents see whose group does not say it [m]: an agent composes what it sees;
    default: everything, as a centralised controller always does, and agents that split one
    condition between them."""
    authority: NonNegative = 0.01
    """Below this span max c_i u - min c_i u of the composed row an agent's backup is futile."""

    _function: SafeSetFunction = PrivateAttr()
    _alpha: tuple[ClassK, ...] = PrivateAttr()

    @model_validator(mode="after")
    def _resolve(self) -> Self:
        if self.control == "centralised" and self.composition == "pairs":
            message = "expected 'lse' where safety.control is 'centralised'"
            raise misplaced(("composition",), message, self.composition)
        if self.computes_margin and self.eta:
            message = f"expected no value, or 0: margin = '{self.margin}' computes it"
            raise misplaced(("eta",), message, self.eta)
        if not self.computes_margin and "eta" not in self.model_fields_set:
            raise misplaced(("eta",), "expected a value, or margin = 'local' or 'integrated'", None)
        if self.margin == "integrated" and self.composition == "lse":
            message = "expected composition = 'pairs', or another margin: it bounds a pair's row"
            raise misplaced(("margin",), message, self.margin)
        self._function = built("function", SafeSetFunction, self.function)
        self._alpha = tuple(_class_k(place, given) for place, given in enumerate(self.alpha))
        if self.margin == "integrated" and not isinstance(self._alpha[-1], Linear):
            message = "expected a number, or another margin: 'integrated' needs a linear α_q"
            raise misplaced(("alpha", len(self.alpha) - 1), message, self.alpha[-1])
        return self

    # What follows from the choices. Code outside this room asks these, and no choice by its name.

    @property
    def pairwise(self) -> bool:
        """Whether an agent keeps one row for each of its pairs, and not one row for h_tot."""
        return self.composition == "pairs"

    @property
    def centralised(self) -> bool:
        """Whether one controller decides for all normal agents."""
        return self.control == "centralised"

    @property
    def joint(self) -> bool:
        """Whether normal agents count on one another's best effort: by shares, or centralised."""
        return self.centralised or self.information.shares

    @property
    def shares_one_row(self) -> bool:
        """Whether normal agents split the one condition of h_tot between them."""
        return self.information.shares and not (self.pairwise or self.centralised)

    @property
    def needs_all_states(self) -> bool:
        """Whether normal agents share one condition, and so must see every state."""
        return self.shares_one_row or self.centralised

    @property
    def counts_on_received(self) -> bool:
        """Whether rows count on inputs that other agents said they apply."""
        return self.information.counts_on_received and not self.centralised

    @property
    def counts_on_newest(self) -> bool:
        """Whether rows count on the last received input, whatever has become of it."""
        return self.counts_on_received and self.information is Information.PAPER

    @property
    def computes_margin(self) -> bool:
        """Whether the margin is a bound, computed at each sample, and not a given number."""
        return self.margin in ("local", "integrated")

    @property
    def bounds_one_row(self) -> bool:
        """Whether the margin is a bound of the one row for h_tot."""
        return self.computes_margin and not self.pairwise

    @property
    def limits_alpha(self) -> bool:
        """Whether the margin is proven only for an α_q that is not too steep."""
        return self.margin == "integrated"

    @property
    def counts_disturbance(self) -> bool:
        """Whether ψ_2 and those after it allow for the disturbance, as the paper's do not."""
        return self.margin != "paper"

    @property
    def xi_of_chain(self) -> float | None:
        """ξ in ψ_1; None where its value at each state takes its place."""
        return None if self.computes_margin else self.xi

    @property
    def safe_set_function(self) -> SafeSetFunction:
        """The safe-set function that the table describes."""
        return self._function

    @property
    def class_k(self) -> tuple[ClassK, ...]:
        """α_1, ..., α_q as given or described by their tables."""
        return self._alpha


def _class_k(place: int, given: float | Table) -> ClassK:
    """α of one place; one that is not class K is an error of its field."""
    if not isinstance(given, dict):
        return Linear(given)
    alpha: ClassK = built("alpha", ClassK, given)
    try:
        require_class_k(alpha)
    except NotClassKError as error:
        got = InWords(f"{error.got!r}: {place_of(alpha, 'value')}")
        raise misplaced(("alpha", place), str(error), got) from error
    except Exception as error:  # of a user's own expression
        reason = str(error).strip().splitlines()[-1]
        message = f"expected an expression that can be checked to be class K ({reason})"
        got = InWords(f"{given.get('type')!r}: {place_of(alpha, 'value', error)}")
        raise misplaced(("alpha", place), message, got) from error
    return alpha
