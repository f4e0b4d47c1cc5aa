"""An agent's network as an ONNX graph: python -m wayfield.policies.learned.onnx FOLDER FILE.onnx

The graph takes `features` (b, inputs) as `perception.Perception` makes them and gives `action` (b, outputs), clipped to
[-1, 1]; what features and actions mean is in the agent's card, which the graph's metadata holds as JSON under "card".
`examples/onnx_drive.py` makes the features of an observation, and a twist of the action, without wayfield.
"""

import json
import os
import pathlib

import click
import numpy as np

from wayfield.policies.learned.agent import Agent, load_agent
from wayfield.system.command_line import OneLineErrors
from wayfield.system.extras import installs
from wayfield.system.storage import write_whole


def export_onnx(agent: Agent, file: str | os.PathLike[str]) -> None:
    """Writes the network of an agent, whole or not at all.

    Raises:
        ImportError: without the extra wayfield[onnx].
        OSError: if the file cannot be written.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    network = agent.network
    activation = {"tanh": "Tanh", "relu": "Relu"}[network.activation]
    nodes, constants, value = [], [], "features"
    last = len(network.sizes) - 2
    for k, (weight, bias) in enumerate(network.layers):
        for name, array in ((f"weight_{k}", weight.T), (f"bias_{k}", bias)):
            constants.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        nodes.append(helper.make_node("Gemm", [value, f"weight_{k}", f"bias_{k}"], [f"sum_{k}"]))
        value = f"sum_{k}"
        if k < last:
            nodes.append(helper.make_node(activation, [value], [f"layer_{k}"]))
            value = f"layer_{k}"
    constants += [
        numpy_helper.from_array(np.array(end, np.float32), name) for name, end in (("least", -1.0), ("most", 1.0))
    ]
    nodes.append(helper.make_node("Clip", [value, "least", "most"], ["action"]))
    graph = helper.make_graph(
        nodes,
        str(agent.card.get("name", "agent")),
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, ["robots", int(network.sizes[0])])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["robots", int(network.sizes[-1])])],
        constants,
    )
    # an old operator set, so that old runtimes read it too
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    helper.set_model_props(model, {"card": json.dumps(agent.card)})
    onnx.checker.check_model(model)
    write_whole(pathlib.Path(file), model.SerializeToString())


@click.command("onnx", cls=OneLineErrors)
@click.argument("folder", type=click.Path(path_type=pathlib.Path))
@click.argument("file", type=click.Path(path_type=pathlib.Path, dir_okay=False))
@click.option("--force", is_flag=True, help="Overwrite FILE where there is one.")
def main(folder: pathlib.Path, file: pathlib.Path, force: bool) -> None:
    """Writes the network of the agent in FOLDER, such as results/mine/seed_0/best, to FILE as an ONNX graph."""
    if file.exists() and not force:
        raise click.UsageError(f"{file} exists; --force overwrites it")
    if not file.absolute().parent.is_dir():
        raise click.UsageError(f"{file} cannot be written: there is no folder {file.absolute().parent}")
    try:
        export_onnx(load_agent(folder), file)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    except ModuleNotFoundError as error:
        raise click.ClickException(f"{error.name} is missing: {installs('onnx')}") from None


if __name__ == "__main__":
    main()
