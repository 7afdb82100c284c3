"""docs/deploy/kubernetes.yaml: valid, and every pod is given its own key alone."""

import os
import subprocess
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

import phalanx

MANIFEST = Path(__file__).parents[3] / "docs" / "deploy" / "kubernetes.yaml"
RESOURCES = list(yaml.safe_load_all(MANIFEST.read_text()))
BY_NAME = {(each["kind"], each["metadata"]["name"]): each for each in RESOURCES}
PODS = {
    name: resource["spec"]["template"]["spec"]
    for (kind, name), resource in BY_NAME.items()
    if kind == "Job"
}


@pytest.mark.parametrize("kind_and_name", BY_NAME, ids=str)
def test_every_resource_fits_its_schema(kind_and_name: tuple[str, str]) -> None:
    kubernetes_validate.validate(BY_NAME[kind_and_name], "1.30", strict=True)


def test_a_misspelt_field_would_be_refused() -> None:
    broken = yaml.safe_load(
        MANIFEST.read_text().replace("backoffLimit", "backofLimit").split("---")[3]
    )
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(broken, "1.30", strict=True)


def test_there_is_a_pod_for_every_agent_of_the_scenario() -> None:
    run = BY_NAME["ConfigMap", "phalanx-run"]["data"]
    job = BY_NAME["Job", "agents"]["spec"]
    agents = phalanx.load(run["PHALANX_SCENARIO"]).programs()
    assert job["completions"] == job["parallelism"] == len(agents)
    assert job["completionMode"] == "Indexed"
    (agent,) = job["template"]["spec"]["containers"]
    (command,) = (word for word in agent["command"] if "phalanx agent" in word)
    numbered = [ran(command, index) for index in range(job["completions"])]
    assert numbered == [["agent", name, "--timeout", "300"] for name in agents]


def ran(command: str, index: int) -> list[str]:
    """The arguments with which a pod's command starts phalanx."""
    shown = "phalanx() { printf '%s\\n' \"$@\"; }; " + command.replace("exec ", "")
    environment = {**os.environ, "JOB_COMPLETION_INDEX": str(index)}
    return subprocess.check_output(["sh", "-c", shown], env=environment, text=True).split()


def test_the_pod_of_an_index_is_shown_the_key_of_its_agent_alone() -> None:
    pod = PODS["agents"]
    (agent,) = pod["containers"]
    (mount,) = (m for m in agent["volumeMounts"] if m["name"] == "keys")
    assert mount["subPathExpr"] == "$(JOB_COMPLETION_INDEX)"
    (keys,) = (volume["projected"] for volume in pod["volumes"] if volume["name"] == "keys")
    projected = {
        source["secret"]["name"]: [item["path"] for item in source["secret"]["items"]]
        for source in keys["sources"]
    }
    files = ("ca.crt", "tls.crt", "tls.key")
    assert projected == {f"phalanx-{n + 1}": [f"{n}/{file}" for file in files] for n in range(5)}


def test_plant_and_viewer_are_given_one_secret_of_those_that_are_made() -> None:
    secrets = {
        name: [v["secret"]["secretName"] for v in pod["volumes"] if "secret" in v]
        for name, pod in PODS.items()
    }
    assert secrets == {"plant": ["phalanx-plant"], "agents": [], "viewer": ["phalanx-viewer"]}
    assert "for name in plant viewer 1 2 3 4 5; do" in MANIFEST.read_text()


@pytest.mark.parametrize("job", PODS)
def test_every_pod_fits_the_restricted_profile(job: str) -> None:
    """It meets Pod Security's restricted profile, and its root file system is read-only."""
    pod = PODS[job]
    assert pod["securityContext"]["runAsNonRoot"]
    assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    assert not {"hostNetwork", "hostPID", "hostIPC"} & set(pod)
    assert not pod["automountServiceAccountToken"]
    kinds = {kind for volume in pod["volumes"] for kind in volume if kind != "name"}
    assert kinds <= {"secret", "projected", "emptyDir", "persistentVolumeClaim"}
    for container in pod["containers"]:
        assert container["securityContext"] == {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        assert not any("hostPort" in port for port in container.get("ports", []))


def test_pods_of_the_run_reach_the_plant_alone() -> None:
    """And names of the cluster; an agent does not reach the viewer's page."""
    pods = {"plant", "agent", "viewer"}
    allowed: dict[tuple[str, str], set[str]] = {}
    for (kind, _), resource in BY_NAME.items():
        if kind != "NetworkPolicy":
            continue
        spec = resource["spec"]
        assert set(spec["policyTypes"]) == {"Ingress", "Egress"}
        for pod in selected(spec["podSelector"]):
            for way, ends in (("ingress", "from"), ("egress", "to")):
                others = [end for rule in spec.get(way, []) for end in rule[ends]]
                inside = [end["podSelector"] for end in others if "namespaceSelector" not in end]
                allowed[pod, way] = {other for each in inside for other in selected(each)}
    assert (
        {pod for pod, _ in allowed}
        == pods
        == {
            each["metadata"]["labels"]["phalanx"]
            for (kind, _), resource in BY_NAME.items()
            if kind == "Job" and (each := resource["spec"]["template"])
        }
    )
    assert allowed["plant", "ingress"] == {"agent", "viewer"}
    assert allowed["plant", "egress"] == set()
    for pod in ("agent", "viewer"):
        assert allowed[pod, "ingress"] == set()
        assert allowed[pod, "egress"] == {"plant"}


def test_the_page_is_served_to_its_own_pod_alone() -> None:
    (viewer,) = PODS["viewer"]["containers"]
    assert "--host" not in viewer["args"], "on 127.0.0.1, for kubectl port-forward"
    assert "ports" not in viewer
    assert {name for kind, name in BY_NAME if kind == "Service"} == {"plant"}


def selected(by: dict[str, Any]) -> set[str]:
    """The pods of the run that a selector selects."""
    named = {by["matchLabels"]["phalanx"]} if "matchLabels" in by else set()
    return named.union(*(each["values"] for each in by.get("matchExpressions", [])))
