"""What the tests of the scripts in blend/ share: small scenes, and running a script as its callers do."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from protocol import located

ROOT = Path(__file__).parents[2]
CLOUD_SCENE = ROOT / "parity" / "scenes" / "procedural-clouds.scene.json"
CLOUD_BLEND = ROOT.parent / "shared" / "reference" / "procedural-clouds.blend"

# Where CLOUDPARITY_REQUIRE names bpy, a test without it fails instead of being left out.
IS_BPY_REQUIRED = "bpy" in os.environ.get("CLOUDPARITY_REQUIRE", "").split(",")
requires_bpy = pytest.mark.skipif(
    find_spec("bpy") is None and not IS_BPY_REQUIRED, reason="bpy is not installed"
)


class Recorder:
    """Stands in for protocol.Messages and keeps the warnings."""

    def __init__(self):
        self.warnings = []

    def warning(self, place, message):
        self.warnings.append((place, message))

    def progress(self, done, what):
        pass

    def activity(self, what):
        pass


def run_script(name, request, environment=None):
    """Run blend/NAME with a request (object, or text as it is); return (events, exit status)."""
    text = request if isinstance(request, str) else json.dumps(request)
    settings = {key: value for key, value in os.environ.items() if key != "CYCLES_CPU_NO_AVX2"}
    finished = subprocess.run(
        [sys.executable, ROOT / "blend" / name],
        input=text,
        capture_output=True,
        text=True,
        env=settings | (environment or {}),
    )
    return [json.loads(line) for line in finished.stdout.splitlines()], finished.returncode


def run_apart(code):
    """Run Python code in a process of its own that sees blend/ and tests/python, and leaves without
    destructors: Blender's module aborts some time after it has made a fluid domain."""
    modules = {"PYTHONPATH": os.pathsep.join(map(str, (ROOT / "tests" / "python", ROOT / "blend")))}
    command = [sys.executable, "-c", f"import os\n{code}\nos._exit(0)"]
    subprocess.run(command, check=True, capture_output=True, env=os.environ | modules)


def cloud_scene():
    """The committed cloud scene."""
    return located(json.loads(CLOUD_SCENE.read_text(encoding="utf-8")), "scene")


def matrix(location=(0.0, 0.0, 0.0), scale=(1.0, 1.0, 1.0)):
    """Rows of a world matrix of scale and translation."""
    return [[scale[row] * (row == column) for column in range(3)] + [location[row]] for row in range(3)] + [
        [0.0, 0.0, 0.0, 1.0]
    ]


def node(name, kind, inputs=None, **properties):
    """A node of a graph."""
    return {
        "name": name,
        "type": kind,
        "location": [0.0, 0.0],
        "properties": properties,
        "inputs": inputs or {},
    }


def link(name, socket):
    """A link from the output `socket` of node `name`."""
    return {"node": name, "socket": socket}


def scene(nodes, groups=()):
    """The cube of edge 2, seen along +Y through its centre by every pixel, with a graph of `nodes`."""
    return located(
        {
            "format": "cloudparity-scene/1",
            "name": "test",
            "camera": {
                "name": "Camera",
                "projection": "orthographic",
                "matrix_world": [[1, 0, 0, 0], [0, 0, -1, -5], [0, 1, 0, 0], [0, 0, 0, 1]],
                "focal_length": 50.0,
                "sensor_fit": "AUTO",
                "sensor_width": 36.0,
                "sensor_height": 24.0,
                "ortho_scale": 0.001,
                "shift": [0.0, 0.0],
                "clip_start": 0.1,
                "clip_end": 100.0,
            },
            "film": {
                "resolution": [32, 32],
                "resolution_percentage": 100,
                "pixel_aspect": [1.0, 1.0],
                "pixel_filter": "BOX",
                "filter_width": 1.5,
                "exposure": 1.0,
                "transparent": False,
            },
            "integrator": {"volume_bounces": 0, "max_bounces": 12},
            "display": {"view_transform": "Standard", "look": "None", "exposure": 0.0, "gamma": 1.0},
            "lights": [],
            "world": {"color": [1.0, 0.5, 0.25], "strength": 1.0},
            "volume": {
                "object": "Cube",
                "matrix_world": matrix(),
                "shape": {"type": "box"},
                "bounds": {"min": [-1.0, -1.0, -1.0], "max": [1.0, 1.0, 1.0]},
                "texture_space": {"location": [0.0, 0.0, 0.0], "size": [1.0, 1.0, 1.0]},
                "material": "Material",
                "volume_step_rate": 1.0,
            },
            "graph": {"material": "Material", "nodes": list(nodes), "groups": list(groups)},
        },
        "scene",
    )


def principled_nodes(inputs):
    """A graph of one Principled Volume with these `inputs`, {identifier: number, list or link}."""
    return [
        node(
            "Material Output",
            "ShaderNodeOutputMaterial",
            {"Volume": link("Principled Volume", "Volume")},
            is_active_output=True,
            target="ALL",
        ),
        node("Principled Volume", "ShaderNodeVolumePrincipled", inputs),
    ]


def absorbing_nodes(density):
    """A graph that only absorbs, sigma_t = `density`: a number or a link."""
    return principled_nodes({"Color": [0.0, 0.0, 0.0, 1.0], "Density": density})


def built_program():
    """The program as `cargo build --release` leaves it; tests of Rust run before these and build it."""
    target = os.environ.get("CARGO_TARGET_DIR", "target")
    path = ROOT / os.environ.get("CLOUDPARITY_PROGRAM", f"{target}/release/cloudparity")
    if not path.exists():
        message = f"{path} is not built; CLOUDPARITY_PROGRAM names another"
        assert not os.environ.get("CLOUDPARITY_REQUIRE"), message
        pytest.skip(message)
    return path
