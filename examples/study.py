"""Study the margin that Simulation 1 needs, and how it depends on loss in the network.

python examples/study.py

Each row has the bits of its run as processes; asked again with more seeds, only those are run.
"""

import phalanx

if __name__ == "__main__":
    study = phalanx.study(
        "unicycles",
        seeds=2,
        overrides={"duration": 6.0},
        vary={"safety.eta": [0.0, 2.0, 8.0566], "network.loss": [0.0, 0.5]},
        out="studies/margins",
    )
    print("   η   loss   unsafe   worst h")
    for (eta, loss), runs in study.frame.group_by(study.axes, maintain_order=True):
        unsafe = (runs["outcome"] == phalanx.Outcome.VIOLATED).sum()
        print(f"{eta:5.1f}  {loss:5.1f}   {unsafe} of {len(runs)}   {runs['worst_h'].max():10.2f}")
    print(study.page())
