"""In which units h and the ψ of a scenario are, if its safe-set functions say so."""

from phalanx.scenario.model import Scenario


def unit_of_psi(scenario: Scenario, k: int = 0) -> str:
    """That of ψ_k: of h for each second to the power k, such as "m²/s²"; "" if h's is unknown.

    A function says it as its attribute `unit`. Pairs and limits may differ in it.
    """
    limits = [limit.boundary.limit for limit in scenario.limits]
    functions = [scenario.safety.safe_set_function(), *limits]
    found = {getattr(function, "unit", "") for function in functions}
    of_h = str(found.pop()) if len(found) == 1 else ""
    if not of_h or k == 0:
        return of_h
    return f"{of_h}/s{'' if k == 1 else str(k).translate(_SUPERSCRIPT)}"


_SUPERSCRIPT = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
