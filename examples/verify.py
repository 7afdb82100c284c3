"""Run on one engine, verify on the other: the trajectory is the same to the last bit.

python examples/verify.py
"""

import phalanx

scenario = phalanx.load("formation3d", overrides={"duration": 10.0})
run = phalanx.run(scenario, engine="in-process")
verification = phalanx.verify(run, engine="processes")
print(verification)
print("as it should be" if verification else "this is a defect: please report it")
