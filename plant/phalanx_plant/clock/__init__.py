"""Lockstep and real time: the order of events, and the answers each of them waits for."""
