"""A teacher trained from scratch: TQC (Kuznetsov et al., 2020, arXiv:2005.04269) by sb3-contrib."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np
from torch import Tensor, nn

from lfobench.contract.suite import Environment
from lfobench.errors import UserError
from tools.teachers import Array, Teacher


def train_teacher(environment: Environment, steps: int, seed: int) -> Teacher:
    """TQC's actor after `steps` environment steps; fewer steps make a weaker policy.

    Raises:
        UserError: the extra ``experts`` is not installed.
    """
    try:
        from sb3_contrib import TQC
    except ImportError as error:
        raise UserError(
            "Training from scratch needs stable-baselines3 and sb3-contrib.",
            "Install them: pip install 'lfobench[experts]'.",
        ) from error
    trained = TQC("MlpPolicy", environment.make(), learning_starts=min(10_000, steps // 2), seed=seed, device="cpu")
    trained.learn(steps)
    # sb3-contrib annotates the log-std layer as a parameter.
    actor: Any = trained.policy.actor
    layers = [layer for layer in (*actor.latent_pi, actor.mu) if isinstance(layer, nn.Linear)]
    inputs = layers[0].in_features
    return Teacher(
        weights=tuple(_array(layer.weight) for layer in layers),
        biases=tuple(_array(layer.bias) for layer in layers),
        log_std_weight=_array(actor.log_std.weight),
        log_std_bias=_array(actor.log_std.bias),
        shift=np.zeros(inputs),
        scale=np.ones(inputs),
        clip=np.inf,
        activation="relu",
        squash=True,
        provenance={
            "source": f"sb3-contrib {version('sb3-contrib')}, TQC with its default settings",
            "path": f"trained from scratch for {steps} steps, seed {seed}",
            "licence": "MIT",
        },
    )


def _array(parameter: Tensor) -> Array:
    array: Array = parameter.detach().double().numpy()
    return array
