"""How large a recording is, as a whole and for each agent and second."""

from phalanx.recording.read import Recording


def size_in_words(recording: Recording) -> str:
    """Such as "2.6 MB, 5.1 kB for each agent and second of virtual time"."""
    size = recording.path.stat().st_size
    agents = sum(group.size for group in recording.scenario.agents)
    seconds = recording.states[-1].t if recording.states else 0.0
    total = f"{size / 1e6:.3g} MB"
    if not seconds:
        return total
    each = size / (agents * seconds)
    return f"{total}, {each / 1e3:.3g} kB for each agent and second of virtual time"
