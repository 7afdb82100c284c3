"""What a swarm's topics are called in ROS 2."""

import re
from collections.abc import Sequence

NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
"""ROS 2's namespaces, but for the root."""


def pose_topics(namespace: str, names: Sequence[str]) -> list[str]:
    """The topic of each agent's pose, such as "/phalanx/agent_1/pose".

    ROS 2 has no "-" in names and no digit at their beginning, as agents' may have. Raises
    ValueError if two agents would share a topic.
    """
    topics = [f"{namespace}/agent_{name.replace('-', '_')}/pose" for name in names]
    for name, topic in zip(names, topics, strict=True):
        other = names[topics.index(topic)]
        if other != name:
            raise ValueError(f"agents {other} and {name} would share the topic {topic}")
    return topics
