"""CITATION.cff is what the Citation File Format asks for, and of this version."""

import copy
import json
import re

import jsonschema
import pytest
import yaml

from blend_support import ROOT

SCHEMA = ROOT / "tests" / "data" / "citation" / "citation-file-format-1.2.0.schema.json"


@pytest.fixture(scope="module")
def citation():
    # Every value is a text: the schema says which texts are dates.
    return yaml.load((ROOT / "CITATION.cff").read_text(encoding="utf-8"), Loader=yaml.BaseLoader)


@pytest.fixture(scope="module")
def validator():
    return jsonschema.Draft7Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))


def test_the_file_is_valid(citation, validator):
    assert [error.message for error in validator.iter_errors(citation)] == []


@pytest.mark.parametrize("key", ["title", "authors", "message", "cff-version"])
def test_the_schema_would_miss_a_key(citation, validator, key):
    broken = copy.deepcopy(citation)
    del broken[key]
    assert any(key in error.message for error in validator.iter_errors(broken))


def test_version_and_licences_are_those_of_the_program(citation):
    manifest = (ROOT / "Cargo.toml").read_text(encoding="utf-8")
    assert citation["version"] == re.search(r'^version = "(.*)"$', manifest, re.MULTILINE).group(1)
    licence = re.search(r'^license = "(.*)"$', manifest, re.MULTILINE).group(1)
    assert sorted(citation["license"]) == sorted(licence.split(" OR "))
