"""What a command keeps of a scan."""

import numpy as np
import pytest

from occ_recon_ros.report.heard import Spool


def test_a_spool_gives_back_the_last_of_each_stamp():
    spool = Spool(bytes)
    spool.keep(5, b"five")
    spool.keep(3, b"three")
    spool.keep(5, b"FIVE")
    assert {stamp: spool[stamp] for stamp in spool} == {5: b"FIVE", 3: b"three"}
    assert 4 not in spool
    with pytest.raises(KeyError):
        spool[4]
    spool.clear()
    assert len(spool) == 0
    spool.keep(3, b"again")
    assert dict(spool) == {3: b"again"}


def test_a_spool_of_much_is_a_file(tmp_path):
    spool, rng = Spool(bytes, tmp_path), np.random.default_rng(1)
    parts = [rng.bytes(1 << 20) for _ in range(80)]
    for k, part in enumerate(parts):
        spool.keep(k, part)
    assert spool._file._rolled  # no longer in memory
    assert all(spool[k] == parts[k] for k in rng.permutation(80).tolist())
    assert list(tmp_path.iterdir()) == []  # it has no name, and so leaves nothing behind
