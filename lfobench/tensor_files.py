"""Tensor files with a digest: checkpoints, policies and labels. Damage is noticed, and no pickle is read."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from safetensors import SafetensorError, safe_open

from lfobench.files import replacing

if TYPE_CHECKING:
    from torch import Tensor

KEY = "lfobench"
"""The only key of a file's metadata; with several, their order and so the bytes would change from run to run."""


class DamagedFile(Exception):
    """Not a tensor file of ours, or not what was written."""


def write_tensors(path: Path, tensors: Mapping[str, Tensor], about: Mapping[str, Any]) -> None:
    """Write tensors and JSON data about them, whole or not at all; equal contents are equal bytes.

    Raises:
        UserError: when the disk refuses.
    """
    from safetensors.torch import save_file

    contiguous = {name: tensors[name].detach().cpu().contiguous() for name in sorted(tensors)}
    text = json.dumps(about, sort_keys=True)
    sealed = json.dumps({"about": text, "digest": _digest(contiguous, text)}, sort_keys=True)
    with replacing(path) as temporary:
        save_file(contiguous, temporary, {KEY: sealed})


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """The tensors of a file, and the JSON data about them.

    Raises:
        DamagedFile: unreadable, or not what was written.
        FileNotFoundError: there is no such file.
    """
    try:
        if path.exists() and not path.is_file():
            raise DamagedFile("it is not a regular file")
        with safe_open(path, framework="pt") as file:
            sealed = json.loads((file.metadata() or {})[KEY])
            tensors = {name: file.get_tensor(name) for name in file.offset_keys()}
        text = sealed["about"]
        if not isinstance(text, str):
            raise DamagedFile("its metadata is not text")
        if sealed["digest"] != _digest(tensors, text):
            raise DamagedFile("its contents do not match its digest")
        about = json.loads(text)
    except FileNotFoundError:
        raise
    except KeyError as error:
        raise DamagedFile("it has no digest of lfobench; an older version may have made it") from error
    except (OSError, SafetensorError, ValueError, TypeError, RecursionError) as error:
        raise DamagedFile(str(error)) from error
    if not isinstance(about, dict):
        raise DamagedFile("it says nothing about its tensors")
    return tensors, about


def _digest(tensors: Mapping[str, Tensor], about: str) -> str:
    digest = hashlib.sha256(about.encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(f"\n{name} {tensor.dtype} {list(tensor.shape)}\n".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()
