"""Files of a release beside the code: they agree with it, and with each other."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SCM = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools_scm"]
CHANGES = (ROOT / "CHANGELOG.md").read_text()
WORKFLOWS = [str(path.relative_to(ROOT)) for path in ROOT.glob(".github/**/*.yml")]


@pytest.mark.parametrize("path", ["CITATION.cff", ".pre-commit-config.yaml", *WORKFLOWS])
def test_files_of_yaml_can_be_read(path: str):
    assert isinstance(yaml.safe_load((ROOT / path).read_text()), dict)


def test_the_citation_and_versions_without_git_are_those_of_the_changelog():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    versions = re.findall(r"^## (\d+\.\d+\.\d+)(, not yet released)?$", CHANGES, re.MULTILINE)
    (latest, unreleased), released = versions[0], [version for version, coming in versions if not coming]
    assert SCM["fallback_version"] == (f"{latest}.dev0" if unreleased else latest)
    assert citation["version"] == (released or [latest])[0]
    assert citation["license"] == PROJECT["license"]
    assert {"cff-version", "title", "message", "authors"} <= citation.keys()


def test_the_workflow_runs_what_a_newcomer_does_on_each_python_that_is_claimed():
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]
    newcomer = jobs["newcomer"]
    assert [step["run"] for step in newcomer["steps"] if "run" in step] == [".ci/run"]
    claimed = {name.rpartition(" ")[2] for name in PROJECT["classifiers"] if re.search(r"Python :: 3\.\d+$", name)}
    assert claimed <= set(newcomer["strategy"]["matrix"]["python"])


def test_the_papers_references_are_cited_and_exist():
    paper, references = ((ROOT / "docs/paper" / name).read_text() for name in ("paper.md", "paper.bib"))
    cited = set(re.findall(r"@([a-z_0-9]+)", paper.partition("# Summary")[2]))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", references, re.MULTILINE))


def test_pages_that_are_named_for_language_models_exist():
    pages = re.findall(r"\(([A-Z]+)\.html\)", (ROOT / "docs/llms.txt").read_text())
    assert len(pages) > 8
    assert [page for page in pages if not (ROOT / "docs" / f"{page}.md").exists()] == []


@pytest.mark.parametrize("name", ["Containerfile", "balloon-warp.def"])
def test_images_install_extras_and_warm_up_scenes_that_there_are(name: str):
    recipe = (ROOT / "docs/container" / name).read_text()
    extras = re.findall(r"\[([a-z,]+)\]\"", recipe)[0].split(",")
    assert set(extras) <= PROJECT["optional-dependencies"].keys()
    assert all((ROOT / "scenes" / f"{scene}.toml").exists() for scene in re.findall(r"warm-up (\w+)", recipe))


def test_workflows_show_coverage_and_make_the_site_of_every_version():
    steps = {
        name: [step.get("run", "") for step in job["steps"]]
        for path in WORKFLOWS
        for name, job in (yaml.safe_load((ROOT / path).read_text()).get("jobs") or {}).items()
    }
    assert any("coverage report" in run and "GITHUB_STEP_SUMMARY" in run for run in steps["coverage"])
    assert ".ci/site build/site" in steps["site"]
    assert (ROOT / ".ci/site").stat().st_mode & 0o100


@pytest.mark.parametrize("page", ["PHYSICS", "RUBBER", "GAS", "CONTACT", "LAWS", "METHODS", "RESEARCHERS"])
def test_pages_of_physics_say_what_is_differentiable(page: str):
    text = (ROOT / f"docs/{page}.md").read_text()
    assert "differentia" in text
    assert "(GRADIENTS.md#what-is-differentiable)" in text
    assert "\n## What is differentiable\n" in (ROOT / "docs/GRADIENTS.md").read_text()


def test_the_start_page_leads_each_kind_of_reader_on():
    cards = re.findall(r"\[\*\*(\w+)\*\*\]\((\w+\.md)\)", (ROOT / "docs/index.md").read_text())
    assert [name for name, _ in cards] == ["Animate", "Research", "Learn", "Play"]
    assert all((ROOT / "docs" / page).exists() for _, page in cards)
