"""Which values of an exported graph decide its medium: the targets of a probe."""

CLOSURES = {
    "ShaderNodeVolumePrincipled",
    "ShaderNodeVolumeScatter",
    "ShaderNodeVolumeAbsorption",
    "ShaderNodeVolumeCoefficients",
    "ShaderNodeEmission",
}


def targets(graph):
    """The outputs that are linked into the closures and mixes of a graph, as /GROUP/.../NODE.SOCKET, sorted.

    What stands in an input as a number is no field; an input of a group that is linked outside of it is
    followed there.
    """
    trees = {group["name"]: group["nodes"] for group in graph["groups"]}
    found, seen = set(), set()

    def nodes_of(path):
        nodes = graph["nodes"]
        for name in path:
            nodes = trees[next(node["group"] for node in nodes if node["name"] == name)]
        return {node["name"]: node for node in nodes}

    def follow(value, path):
        """Note what `value`, an input of a node of the tree at `path`, comes from."""
        if not isinstance(value, dict):
            return
        if "group_input" in value:
            outside = nodes_of(path[:-1])[path[-1]]["inputs"]
            follow(outside.get(value["group_input"]), path[:-1])
            return
        key = (path, value["node"], value["socket"])
        if key in seen:
            return
        seen.add(key)
        node = nodes_of(path)[value["node"]]
        inputs = node["inputs"]
        if node.get("muted"):
            follow(inputs.get(node["bypass"].get(value["socket"])), path)
        elif node["type"] == "NodeReroute":
            follow(inputs.get("Input"), path)
        elif node["type"] == "ShaderNodeGroup":
            inside = (*path, node["name"])
            output = next(item for item in nodes_of(inside).values() if item["type"] == "NodeGroupOutput")
            follow(output["inputs"].get(value["socket"]), inside)
        elif node["type"] in CLOSURES or node["type"] in ("ShaderNodeAddShader", "ShaderNodeMixShader"):
            for source in inputs.values():
                follow(source, path)
        else:
            found.add("".join(f"/{name}" for name in (*path, node["name"])) + f".{value['socket']}")

    output = next(node for node in graph["nodes"] if node["type"] == "ShaderNodeOutputMaterial")
    follow(output["inputs"].get("Volume"), ())
    return sorted(found)
