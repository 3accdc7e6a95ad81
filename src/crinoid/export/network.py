"""A policy for runtimes of neural networks: the step of a control period as a graph of ONNX."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Array
from onnx import ModelProto, NodeProto, TensorProto, ValueInfoProto, helper, numpy_helper

from crinoid.assembly.description import Description
from crinoid.control.policy import Policy
from crinoid.export.files import PRODUCER
from crinoid.version import __version__

_OPSET = 13
"""Set of operators: that of 2020, old enough for most runtimes."""


def model_of(policy: Policy, told: Description) -> ModelProto:
    """Return what `crinoid.control.Neural` does in a control period, as a graph of ONNX.

    Parameters
    ----------
    policy, told
        As `crinoid.assembly.weights.read_policy` returns them.
    """
    graph = _Graph()
    entries, driven = policy.centre.size, policy.fastest.size
    commands, observed = _listed(told.actions), _listed(told.observations)
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
    features = _features(graph, policy, row)
    fastest = graph.number("fastest", policy.fastest)
    moves = graph.add("Mul", fastest, _share(graph, policy, features))
    wanted = graph.add("Add", "command", moves)
    graph.add("Min", graph.add("Max", wanted, "lower"), "upper", name="next_command")
    gone = graph.add("Sub", "averages", row)
    kept = graph.add("Mul", graph.number("kept", policy.kept[:, None]), gone)
    graph.add("Add", row, kept, name="next_averages")
    made = helper.make_graph(graph.nodes, "policy", inputs, outputs, graph.numbers)
    opset = helper.make_opsetid("", _OPSET)
    model = helper.make_model(
        made,
        producer_name=PRODUCER,
        producer_version=__version__,
        opset_imports=[opset],
        # the oldest that has these operators, which old runtimes read as well
        ir_version=helper.find_min_ir_version_for([opset]),
        doc_string=f"Commands {told.rate_hz:g} times a second: {commands}",
    )
    about = {name: json.dumps(value) for name, value in told._asdict().items()}
    helper.set_model_props(model, {"crinoid_version": __version__} | about)
    return model


def _features(graph: _Graph, policy: Policy, row: str) -> str:
    centre = graph.number("centre", policy.centre[None])
    above = graph.add("Concat", row, "averages", axis=0)
    below = graph.add("Concat", "averages", centre, axis=0)
    flat = graph.shape("features", policy.usual.size)
    change = graph.add("Reshape", graph.add("Sub", above, below), flat)
    return graph.add("Mul", change, graph.number("usual", policy.usual))


def _share(graph: _Graph, policy: Policy, features: str) -> str:
    """Add the network, and return its moves over the largest ones."""
    hidden = features
    for place, layer in enumerate(policy.layers):
        weight = graph.number(f"weight_{place}", layer.weight)
        bias = graph.number(f"bias_{place}", layer.bias)
        if place:
            hidden = graph.add("Tanh", hidden)
        hidden = graph.add("Add", graph.add("MatMul", weight, hidden), bias)
    straight = graph.add("MatMul", graph.number("linear", policy.linear), features)
    swing = graph.number("swing", policy.swing)
    return graph.add("Tanh", graph.add("Mul", swing, graph.add("Add", straight, hidden)))


class _Graph:
    """Nodes and numbers of a graph in the making."""

    def __init__(self) -> None:
        self.nodes: list[NodeProto] = []
        self.numbers: list[TensorProto] = []

    def number(self, name: str, value: Array) -> str:
        """Add an array of numbers of 64 bits."""
        self.numbers.append(numpy_helper.from_array(np.asarray(value, "<f8"), name))
        return name

    def shape(self, name: str, *sizes: int) -> str:
        """Add a shape to bring something into."""
        name = f"shape_of_{name}"
        self.numbers.append(numpy_helper.from_array(np.array(sizes, "<i8"), name))
        return name

    def add(self, kind: str, *inputs: str, name: str = "", **how: int) -> str:
        """Add a node, and return the name of what it gives."""
        name = name or f"{kind.lower()}_{len(self.nodes)}"
        node = helper.make_node(kind, inputs, [name], name=name)
        node.attribute.extend(helper.make_attribute(key, value) for key, value in how.items())
        self.nodes.append(node)
        return name


def _value(name: str, shape: Sequence[int], words: str) -> ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.DOUBLE, shape, words)


def _listed(names: Iterable[Sequence[str]]) -> str:
    return ", ".join(f"{name} ({unit})" for name, unit in names)
