"""Simulation 2 over many seeds: writes docs/simulation-2.md.

python evidence/paper/simulation_2.py --seeds 20 --jobs 2          # 140 s each
python evidence/paper/simulation_2.py --seeds 2 --only paper --out /dev/stdout
"""

from flagship import section
from seeds import (
    CERTIFICATES,
    Results,
    Variant,
    certificates,
    command,
    spread,
    with_authority,
    with_empty_set,
)

VARIANTS = {
    "paper": Variant("β = 2/3", "formation3d"),
    "no-margin": Variant("β = 2/3, η = 0, ξ = 0", "formation3d", ("safety.eta=0", "safety.xi=0")),
    "beta3": Variant("β = 3", "formation3d-beta3"),
}


def page(results: Results) -> str:
    """docs/simulation-2.md."""
    lines = [
        "# Simulation 2: eight double integrators in 3-D, four of them attacking",
        "",
        "Verdicts of the paper's second simulation over several seeds, with and without its "
        "margin. `scenarios/formation3d.toml` and `formation3d-beta3.toml` run for 140 s each; "
        "`python evidence/paper/simulation_2.py --seeds 20` writes this page. Runs with `split` "
        "are in `evidence/paper/compositions.md`; how far robots are from their goals is "
        "[with the parameters](paper.md#robots-are-far-from-their-goals-in-simulation-2).",
        "",
        "![Simulation 2: paths, h_tot, and the inputs of a normal agent](images/formation3d.png)",
        "",
        "## Verdicts and certificates",
        "",
        *CERTIFICATES,
        *(certificates(VARIANTS[name].title, by_seed) for name, by_seed in results.items()),
        "",
        "Columns are explained for [Simulation 1](simulation-1.md#verdicts-and-certificates).",
        "",
        "## Safety and empty K_i",
        "",
        "| variant | max h_tot, least to greatest | backup: least, mean, greatest "
        "| with authority |",
        "|---|---|---|---|",
    ]
    for name, by_seed in results.items():
        runs = [each.summary for each in by_seed.values()]
        worst = sorted(run.largest_h_tot for run in runs)
        lines.append(
            f"| {VARIANTS[name].title} | {worst[0]:.1f} to {worst[-1]:.1f} "
            f"| {spread(runs, with_empty_set)} | {spread(runs, with_authority)} |"
        )
    lines += [
        "",
        "h_tot lies above the largest h by up to ln(62) / ρ: 83 with ρ = 0.05, 21 with the 0.2 of "
        "β = 3. So every pair may be safe where h_tot is above zero.",
        "",
    ]
    return "\n".join([*lines, *section("simulation-2")])


if __name__ == "__main__":
    command("simulation-2", VARIANTS, page)
