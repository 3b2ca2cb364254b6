"""The machine by name."""

from __future__ import annotations

import dataclasses
import json
import re

import torch

from benchmarks.hardware import describe


def test_this_machine() -> None:
    found = describe(torch.device("cpu"))
    assert found.cores >= 1
    assert found.gpu is None
    assert found.torch == torch.__version__
    assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", found.slug)
    assert json.loads(json.dumps(found.as_json()))["name"] == found.processor


def test_a_device_names_the_machine() -> None:
    found = dataclasses.replace(describe(torch.device("cpu")), gpu="NVIDIA H100 80GB HBM3")
    assert found.slug == "nvidia-h100-80gb-hbm3"
    assert found.processor in str(found)
