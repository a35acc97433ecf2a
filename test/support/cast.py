"""What cameras around a mesh see of it."""

from occ_recon_ros.evaluation.raycast import RayCaster
from occ_recon_ros.scene import TurntableSettings, turntable_cameras


def cast(mesh):
    """Pairs of a camera and the mesh's silhouette in it, of six views 57 degrees apart."""
    size = {"width": 320, "height": 240, "focal_px": 400}
    cameras = turntable_cameras(TurntableSettings(frames=6, step=1.0, **size))
    caster = RayCaster(mesh.triangles)
    return [(camera, caster.silhouette(camera)) for camera in cameras]
