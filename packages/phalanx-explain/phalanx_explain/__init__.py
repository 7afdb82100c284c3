"""The explanation of a control step: what an agent wanted, which rows kept it, what would free it.

All of it is computed by the agent's own controller, in a repetition of the run.
"""
