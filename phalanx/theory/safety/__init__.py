"""The safe set: h of pairs, its composition, and the chain of its derivatives."""
