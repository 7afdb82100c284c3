"""Virtual time in lockstep, and real time: what comes next, and who is waited for."""
