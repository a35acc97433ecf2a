"""What tests of the joint pass have in common."""

import pytest


@pytest.fixture
def few_heights(monkeypatch):
    """The ground is sought at a quarter of the heights."""
    monkeypatch.setattr("occ_recon_ros.imaging.joint.plane._HEIGHTS", 41)


@pytest.fixture
def coarse(monkeypatch, few_heights):
    """Voxels half as fine, too."""
    monkeypatch.setattr("occ_recon_ros.imaging.joint.solve._GRIDS", (24, 32, 36))
