"""ROS domains that nobody else on this host uses."""

import atexit
import fcntl
import os
import tempfile
from pathlib import Path
from typing import IO

_DOMAINS = range(1, 102)  # those above use ports that Linux gives to others
_claims: dict[int, IO[str]] = {}  # open files, whose locks end with this process


def claim_domain() -> int:
    """A ROS domain that no other process of this user on this host has claimed, until this one
    ends. The lock is on an open file, so that a killed process leaves none behind.

    Raises:
        RuntimeError: all are in use.
    """
    folder = Path(tempfile.gettempdir()) / f"occ_recon_domains_{os.getuid()}"
    folder.mkdir(exist_ok=True)
    for domain_id in _DOMAINS:
        claim = (folder / str(domain_id)).open("w")
        try:
            fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            claim.close()
            continue
        _claims[domain_id] = claim
        atexit.register(claim.close)
        return domain_id
    raise RuntimeError("all ROS domains are in use on this host")
