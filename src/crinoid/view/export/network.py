"""ONNX of a policy: the step of a control period as a graph."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Array
from onnx import ModelProto, NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper

from crinoid.assembly.description import Description
from crinoid.assembly.neural import read_policy
from crinoid.control.neural import Policy
from crinoid.foundation.version import __version__
from crinoid.results.own_files import PRODUCER
from crinoid.results.report_error import ReportError
from crinoid.scenario import ScenarioError
from crinoid.view.export.source import Files, PolicySource, Report

_OPSET = 13  # version of the operators: that of 2020, which most runtimes have


def write_onnx(source: PolicySource, files: Files, report: Report) -> list[str]:
    """Write a policy as a graph of ONNX, which is called once in each control period."""
    try:
        model = model_of(*read_policy(source.path))
    except ScenarioError as error:
        raise ReportError(error.mistakes[0].text) from error
    files[0].write_bytes(model.SerializeToString())
    report(1, 1)
    return []


def model_of(policy: Policy, description: Description) -> ModelProto:
    """Return the step of `crinoid.control.Neural` in a control period as a graph of ONNX.

    Its numbers have 64 bits. Inputs are ``observed`` (entry), ``averages`` (average, entry), and
    ``command``, ``lower`` and ``upper`` (driven): the last commands and their limits. Outputs
    are ``next_command`` and ``next_averages``, for the next call. In the first call all averages
    equal the observation. The file's metadata name entries, commands and their units.

    `crinoid.assembly.neural.read_policy` returns the arguments.
    """
    graph = _Graph()
    entries, driven = policy.centre.size, policy.fastest.size
    commands, observed = _join(description.actions), _join(description.observations)
    memory = [policy.kept.size, entries]
    inputs = [
        _value("observed", [entries], observed),
        _value("averages", memory, "running averages, the shortest first"),
        _value("command", [driven], f"last command: {commands}"),
        _value("lower", [driven], f"smallest command: {commands}"),
        _value("upper", [driven], f"largest command: {commands}"),
    ]
    outputs = [
        _value("next_command", [driven], commands),
        _value("next_averages", memory, "running averages of the next call"),
    ]
    row = graph.add("Reshape", "observed", graph.shape("row", 1, entries))
    above = graph.add("Concat", row, "averages", axis=0)
    below = graph.add("Concat", "averages", graph.number("centre", policy.centre[None]), axis=0)
    flat = graph.shape("features", policy.usual.size)
    change = graph.add("Reshape", graph.add("Sub", above, below), flat)
    features = graph.add("Mul", change, graph.number("usual", policy.usual))
    fastest = graph.number("fastest", policy.fastest)
    moves = graph.add("Mul", fastest, _share(graph, policy, features))
    command = graph.add("Add", "command", moves)
    graph.add("Min", graph.add("Max", command, "lower"), "upper", name="next_command")
    difference = graph.add("Sub", "averages", row)
    decayed = graph.add("Mul", graph.number("kept", policy.kept[:, None]), difference)
    graph.add("Add", row, decayed, name="next_averages")
    made = helper.make_graph(graph.nodes, "policy", inputs, outputs, graph.numbers)
    opset = helper.make_opsetid("", _OPSET)
    model = helper.make_model(
        made,
        producer_name=PRODUCER,
        producer_version=__version__,
        opset_imports=[opset],
        # the oldest with these operators, for old runtimes
        ir_version=helper.find_min_ir_version_for([opset]),
        doc_string=f"Commands {description.rate_hz:g} times a second: {commands}",
    )
    about = {name: json.dumps(value) for name, value in description._asdict().items()}
    helper.set_model_props(model, {"crinoid_version": __version__} | about)
    return model


def _share(graph: _Graph, policy: Policy, features: str) -> str:
    """Add the network, and return its moves as shares of the largest ones."""
    hidden = features
    for place, layer in enumerate(policy.layers):
        weight = graph.number(f"weight_{place}", layer.weight)
        bias = graph.number(f"bias_{place}", layer.bias)
        if place:
            hidden = graph.add("Tanh", hidden)
        hidden = graph.add("Add", graph.add("MatMul", weight, hidden), bias)
    straight = graph.add("MatMul", graph.number("linear", policy.linear), features)
    gain = graph.number("swing", policy.swing)
    return graph.add("Tanh", graph.add("Mul", gain, graph.add("Add", straight, hidden)))


class _Graph:
    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        self.numbers: list[TensorProto] = []

    def number(self, name: str, value: Array) -> str:
        """Add an array of 64-bit numbers."""
        self.numbers.append(numpy_helper.from_array(np.asarray(value, "<f8"), name))
        return name

    def shape(self, name: str, *sizes: int) -> str:
        """Add a shape, an argument of Reshape."""
        name = f"shape_of_{name}"
        self.numbers.append(numpy_helper.from_array(np.array(sizes, "<i8"), name))
        return name

    def add(self, kind: str, *inputs: str, name: str = "", **attributes: int) -> str:
        """Add a node, and return the name of its output."""
        name = name or f"{kind.lower()}_{len(self.nodes)}"
        node = helper.make_node(kind, inputs, [name], name=name)
        node.attribute.extend(helper.make_attribute(*each) for each in attributes.items())
        self.nodes.append(node)
        return name


def _value(name: str, shape: Sequence[int], words: str) -> ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.DOUBLE, shape, words)


def _join(names: Iterable[Sequence[str]]) -> str:
    return ", ".join(f"{name} ({unit})" for name, unit in names)
