"""An array takes memory only while it is read, however many a file has."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from helpers_files import make_episodes, write_minari

from lfobench.data.readers.arrays import array
from lfobench.data.readers.hdf5 import METADATA_BYTES, opened, subgroup


def open_arrays(root: h5py.File) -> int:
    return int(h5py.h5f.get_obj_count(root.id, h5py.h5f.OBJ_DATASET))


def test_an_array_is_open_only_while_it_is_read(tmp_path: Path) -> None:
    episodes = make_episodes()
    with opened(write_minari(tmp_path / "file.hdf5", episodes)) as root:
        found = array(subgroup(root, "episode_1"), "actions", 2)
        assert open_arrays(root) == 0
        assert (found.field, found.shape, found.rows) == ("episode_1/actions", (4, 2), 4)
        np.testing.assert_array_equal(found.read(), episodes.actions[7:11])
        np.testing.assert_array_equal(found.read(1, 3), episodes.actions[8:10])
        assert open_arrays(root) == 0


def test_little_of_a_file_is_kept_beside_its_data(tmp_path: Path) -> None:
    with opened(write_minari(tmp_path / "file.hdf5", make_episodes())) as root:
        assert root.id.get_mdc_config().max_size == METADATA_BYTES
        assert root.id.get_access_plist().get_cache()[2] == 0
