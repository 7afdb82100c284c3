"""The simulated network: link rules, links, and the receiver's inbox."""
