"""The authors' arrays and the engine's view hold the same rows."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.workloads import WORKLOADS, synthetic
from lfobench.contract.method import Shapes

CPU = torch.device("cpu")


@pytest.mark.parametrize("name", WORKLOADS)
def test_a_view_holds_what_the_method_declares(name: str) -> None:
    method = WORKLOADS[name].method
    needs = method.needs(method.Config())
    view = synthetic(Shapes(5, 2), 3000, 99).view(needs, CPU)
    assert (*view.offline.fields, *view.initial.fields) == needs.offline
    assert view.expert.fields == needs.expert
    assert (view.sizes.offline, view.sizes.expert) == (3000, 99)


def test_rows_are_the_same_in_another_order() -> None:
    data = synthetic(Shapes(5, 2), 50, 9)
    needs = WORKLOADS["dilo"].method.needs(WORKLOADS["dilo"].method.Config())
    batch = data.view(needs, CPU).offline.batch(torch.arange(50)[None])
    host = data.host().offline
    engine = torch.cat([batch[field][0].reshape(50, -1) for field in needs.offline], dim=1).numpy()
    authors = np.concatenate([host[field].reshape(50, -1) for field in needs.offline], axis=1)
    assert not np.array_equal(engine, authors)
    np.testing.assert_array_equal(engine[np.lexsort(engine.T)], authors[np.lexsort(authors.T)])


def test_a_triple_is_consecutive() -> None:
    host = synthetic(Shapes(5, 2), 50, 9).host()
    for part in (host.offline, host.expert):
        np.testing.assert_array_equal(part["observation"][1:], part["next_observation"][:-1])
        np.testing.assert_array_equal(part["next_observation"][1:], part["second_next_observation"][:-1])
