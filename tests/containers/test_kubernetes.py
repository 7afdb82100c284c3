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


def test_there_is_a_pod_for_every_agent_of_the_scenario_with_its_secret_where_it_looks() -> None:
    run = BY_NAME["ConfigMap", "phalanx-run"]["data"]
    agents = list(phalanx.load(run["PHALANX_SCENARIO"]).programs())
    job = BY_NAME["Job", "agents"]["spec"]
    assert job["completions"] == job["parallelism"] == len(agents)
    sources = job["template"]["spec"]["volumes"][0]["projected"]["sources"]
    for index, (name, source) in enumerate(zip(agents, sources, strict=True)):
        secret = source["secret"]
        assert name == str(index + 1)
        assert secret["name"] == f"phalanx-{name}"
        assert {item["path"] for item in secret["items"]} == {
            f"{index}/{file}" for file in ("ca.crt", "tls.crt", "tls.key")
        }
