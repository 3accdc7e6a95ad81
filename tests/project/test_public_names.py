"""The public names of crinoid: their docstrings are complete, and their examples run."""

import doctest
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpydoc.docscrape import NumpyDocString

import crinoid

NAMES = sorted(set(crinoid.__all__) - {"__version__"})
METHODS = [
    f"{name}.{method}"
    for name, methods in {
        "AssembledScenario": "mapping",
        "Flow": "velocity",
        "Onset": "of __call__",
        "Result": "load restore save",
        "Scenario": "cases from_dict from_toml to_dict to_toml with_values",
        "Session": "reset result step",
        "System": "advance energy equilibrium find_equilibrium rest step strains tip",
    }.items()
    for method in methods.split()
]
"""Methods that a program calls, with sections as those of functions."""
INTERFACES = {"Actuator", "ActuatorParameters", "Controller", "Element", "Flow", "Measurand"}
"""Classes whose fields are those of subclasses."""


def named(path):
    """Return a public name, or a method of one as it is written."""
    name, _, method = path.partition(".")
    found = getattr(crinoid, name)
    found = inspect.getattr_static(found, method) if method else found
    found = getattr(found, "__func__", found)  # of a class or a static method
    return inspect.unwrap(getattr(found, "method", found))  # as Equinox wraps methods


def described(doc, *sections):
    """Return the names that sections describe, each with its text."""
    return {
        name.strip(): " ".join(each.desc)
        for section in sections
        for each in doc[section]
        for name in each.name.split(",")
    }


@pytest.mark.parametrize("path", [*NAMES, *METHODS])
def test_sections_name_what_goes_in_and_what_comes_out(path):
    target = named(path)
    doc = NumpyDocString(inspect.getdoc(target))
    arguments = set(inspect.signature(target).parameters) - {"self", "cls"}
    given = set() if path in INTERFACES else arguments
    texts = described(doc, "Parameters", "Attributes")
    assert set(texts) >= given
    assert all(texts.values())
    assert all(each.type or each.desc[0].startswith("As for") for each in doc["Parameters"])
    if inspect.isclass(target):
        return
    assert set(texts) == given
    assert doc["Returns"]
    assert all(each.type for each in doc["Returns"])


@pytest.mark.release
@pytest.mark.parametrize("name", NAMES)
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"crinoid": crinoid, "jax": jax, "jnp": jnp, "np": np}
    finder = doctest.DocTestFinder(recurse=False)
    [test] = finder.find(inspect.unwrap(getattr(crinoid, name)), name, module=False, globs=names)
    assert test.examples
    report = []
    doctest.DocTestRunner(verbose=False).run(test, out=report.append)
    assert not report, "".join(report)
