"""phalanx ros2: publish a run to ROS 2 nodes over rmw_zenoh, live or recorded."""

from typing import Annotated

import typer
from phalanx_viewer.commands import LiveRun, RunOrRecording, live_membership

from phalanx.cli.jobs import Job
from phalanx.cli.option_checks import require_endpoint, require_here, require_timeout
from phalanx.cli.options import Connect, Insecure, KeysFolder, Secret, Trust
from phalanx.launcher.streams import echo_error


def register(app: typer.Typer) -> None:
    app.command(rich_help_panel=Job.DEPLOY)(ros2)


def ros2(
    recording: RunOrRecording = None,
    connect: Connect = "",
    run: LiveRun = "",
    secret: Secret = "",
    keys: KeysFolder = None,
    router: Annotated[
        str,
        typer.Option(
            callback=require_endpoint, help="Zenoh endpoint of the ROS 2 router, rmw_zenohd."
        ),
    ] = "tcp/localhost:7447",
    domain: Annotated[
        int, typer.Option(envvar="ROS_DOMAIN_ID", min=0, max=232, help="ROS 2 domain.")
    ] = 0,
    namespace: Annotated[
        str, typer.Option(help="ROS 2 namespace of the node and its topics.")
    ] = "/phalanx",
    timeout: Annotated[
        float,
        typer.Option(
            callback=require_timeout,
            help="How long to try to reach the router and the live run, in seconds.",
        ),
    ] = 10.0,
    insecure: Insecure = False,
    trust: Trust = False,
) -> int:
    """Let ROS 2 read the swarm: poses, markers and diagnostics, without ROS installed here.

    A live run is published until it is over, a recording once, in real time.

    ROS 2 needs RMW_IMPLEMENTATION=rmw_zenoh_cpp, and `ros2 run rmw_zenoh_cpp rmw_zenohd`:

      /phalanx/agent_1/pose  geometry_msgs/PoseStamped, of each agent
      /phalanx/agent_1/peers/agent_2  nav_msgs/Odometry, as 1 heard it by radio
      /phalanx/markers       visualization_msgs/MarkerArray, for RViz
      /diagnostics           diagnostic_msgs/DiagnosticArray, with the verdict

    Examples:

      phalanx ros2 runs/unicycles-1
      phalanx ros2 --connect tcp/plant:7447 --run r1 --router tcp/robot:7447 --insecure
    """
    from phalanx.messages.keys import VIEWER

    membership = live_membership(recording, run, connect, secret, keys, insecure, timeout, VIEWER)
    require_here(
        router, insecure, "--insecure, since ROS 2's router reads and passes on everything"
    )
    from phalanx_viewer.feeds.live import Live
    from phalanx_viewer.feeds.replay import open_replay

    from phalanx.launcher.programs import configure_logging
    from phalanx_ros2.republisher import NAMESPACE, publish
    from phalanx_ros2.rmw_zenoh import NodeName

    if not NAMESPACE.fullmatch(namespace):
        raise typer.BadParameter(f"--namespace: expected such as /phalanx, got {namespace!r}")
    configure_logging()
    node = router, NodeName(domain, namespace, "swarm"), timeout
    try:
        if membership is None:
            assert recording is not None
            return publish(open_replay(recording, trust), *node)
        with Live(membership, trust=trust) as live:
            return publish(live, *node)
    except (RuntimeError, ValueError, OSError) as error:
        echo_error(error)
        return 3
