"""Masks of all views of a calibrated turn together: images and cameras in, masks and what they
are worth out."""

from ..volume import Volume
from .judge import ViewReport
from .learnt import LearntMasks
from .masks import JointMasks
from .segmenter import JointSegmenter, joint_masks

__all__ = ["JointMasks", "JointSegmenter", "LearntMasks", "ViewReport", "Volume", "joint_masks"]
