"""docs/deploy/kubernetes.yaml: valid, and every pod is given its own key alone."""

from pathlib import Path

import kubernetes_validate
import pytest
import yaml

import phalanx

MANIFEST = Path(__file__).parents[2] / "docs" / "deploy" / "kubernetes.yaml"
RESOURCES = list(yaml.safe_load_all(MANIFEST.read_text()))
BY_NAME = {(each["kind"], each["metadata"]["name"]): each for each in RESOURCES}


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


def test_every_pod_is_given_one_secret_of_those_that_are_made() -> None:
    given = {
        name: [v["secret"]["secretName"] for v in spec["volumes"] if "secret" in v]
        for (kind, name), resource in BY_NAME.items()
        if kind == "Job" and (spec := resource["spec"]["template"]["spec"])
    }
    assert given == {
        "plant": ["phalanx-plant"],
        "agents": ["phalanx-claimant"],
        "viewer": ["phalanx-operator"],
    }
    assert "for name in plant operator claimant; do" in MANIFEST.read_text()
