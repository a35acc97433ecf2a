"""A mesh against the silhouettes of a bag, and against the true surface."""

import json
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from skimage.draw import polygon2mask
from skimage.measure import perimeter_crofton

from occ_recon_ros.bags.changes import Changes
from occ_recon_ros.bags.places import refuse_existing, write_file
from occ_recon_ros.bags.views import BagViews, Progress, View
from occ_recon_ros.errors import UserError
from occ_recon_ros.geometry import Contours
from occ_recon_ros.geometry.arrays import evenly
from occ_recon_ros.imaging import ContourTracker, mask_coverage
from occ_recon_ros.imaging.joint.space import usual_distance
from occ_recon_ros.surface.agreement import silhouette_agreement
from occ_recon_ros.surface.covering import LEAST_COVERED, covered_by_hull

from .agreeing_part import agreeing_part
from .corrected import cameras_beside
from .distances import compare_surfaces
from .figures import Report
from .meshes import joined, read_mesh
from .other_frame import in_another_frame
from .raycast import RayCaster

Mask = NDArray[np.bool_]

_NO_UNIT = 100.0  # times a size, that no object is off by, but millimetres taken for metres
_FITS, _FITS_PX = 0.85, 2.0  # IoU, and how far outlines are apart in px: a body that is of these
_HARDLY = 0.05  # of a silhouette, that a mesh which is right where it is lies beyond
_TRIED_IN = 8  # views, spread evenly, in which other axes and units are tried
_ALL_AROUND = 1.9  # times the distance of the cameras: they would stand inside


def evaluate(
    mesh_path: Path,
    views: BagViews,
    truth: Path | None,
    within_mm: float,
    out: Path | None,
    overwrite: bool,
    progress: Progress,
    given_cameras: bool = False,
) -> Report:
    """Hold a mesh against the masks of a bag, or where it has none the contours of its images.

    The views are seen by the cameras that the mesh was made with: those of the bag, or where its
    replay corrected them, those in the report beside it. ``given_cameras`` takes the bag's.

    Raises:
        UserError: a file that cannot be used; no view shows an outline.
    """
    if not within_mm > 0:
        raise UserError(f"--within {within_mm:g}: must be a distance above 0 mm")
    refuse_existing(() if out is None else (out,), overwrite)
    mesh, bag = joined(read_mesh(mesh_path)), views.bag.path
    cameras = None if given_cameras else cameras_beside(mesh_path, views)
    views.changes = Changes(cameras=cameras)
    truth_mesh = joined(read_mesh(truth)) if truth is not None else None
    if truth_mesh is not None:
        ratio = float(truth_mesh.extents.max() / mesh.extents.max())
        if not 1 / _NO_UNIT < ratio < _NO_UNIT:
            raise UserError(
                f"{truth} is {ratio:.3g} times as large as {mesh_path}: give both in metres"
            )
    report: Report = {"mesh": str(mesh_path), "bag": str(bag), "surface": _described(mesh)}
    report["cameras"] = "of the bag" if cameras is None else "corrected by the contours"
    report["doubts"] = _unit_doubts(mesh, views)
    report |= compare_with_silhouettes(mesh, views, progress)
    if not report["views"]:
        raise UserError(f"{bag} has no view with an outline: masks or contours are needed")
    report["doubts"] += _fit_doubts(report, mesh, views)
    if truth_mesh is not None:
        report["truth"] = {"file": str(truth)}
        report["truth"] |= compare_surfaces(mesh, truth_mesh, 1e-3 * within_mm)
    if out is not None:
        write_file(out, (json.dumps(report, indent=1, allow_nan=False) + "\n").encode())
    return report


def _unit_doubts(mesh: trimesh.Trimesh, views: BagViews) -> list[str]:
    """What says that a mesh is in another unit than metres."""
    size = float(mesh.extents.max())
    away = usual_distance(list(views.cameras().values()))
    if 1 / _NO_UNIT < size / away < _ALL_AROUND:
        return []
    what = f"the mesh is {size:.3g} m large, the cameras are {away:.3g} m away"
    return [f"{what}: it may be in another unit (metres are taken)"]


def _fit_doubts(report: Report, mesh: trimesh.Trimesh, views: BagViews) -> list[str]:
    """What says that a mesh is not, or not there, what the views show; and how to read it so that
    it is."""
    iou, apart = report["iou"]["mean"], report["xor_per_outline_px"]["mean"]
    if iou >= _FITS or apart <= _FITS_PX:
        return []
    over, missing = (report[name] for name in ("over_share", "missing_share"))
    far = (
        f"the mesh is far off the silhouettes: of each, in the mean, it lies beyond {over:.0%} and "
        f"leaves out {missing:.0%}; "
    )
    tracker, some = ContourTracker(), views.some(evenly(len(views), _TRIED_IN).tolist())
    seen = [
        (view.camera, _shown(view, tracker, [])[0])
        for view in some
        if view.mask is not None or not views.masked()
    ]
    if said := agreeing_part(mesh, seen, iou) or in_another_frame(mesh, seen, iou):
        return [far + said]
    if not report["surface"]["watertight"] and over < _HARDLY:
        whole = Path(report["mesh"]).with_name("closed.ply")
        rest = f"; the closed body is {whole}" if whole.is_file() else ""
        return [f"of each silhouette, in the mean, the open mesh leaves out {missing:.0%}{rest}"]
    return [
        f"{far}is it of this bag, are its masks of the object, were its poses corrected "
        "(report.json must be beside the mesh)"
    ]


def compare_with_silhouettes(
    mesh: trimesh.Trimesh, views: BagViews, progress: Progress = lambda done, total: None
) -> Report:
    """IoU of the mesh with what each view shows of the object, and XOR in px of its outline.

    Returns:
        ``views``: a row a view: stamp_ns, source (mask or contours), iou, xor_px (pixels in
        one silhouette alone), over_px (those of them in the mesh), outline_px (length of the
        outline) and xor_per_outline_px (their ratio: how far the outlines are apart in the mean);
        ``iou`` and ``xor_per_outline_px``: their mean and worst; ``over_share`` and
        ``missing_share``: what lies beyond the silhouettes and what is left out of them, as mean
        shares of these; ``views_without_outline``: how many could not be used;
        ``judges_disagree``, where contours of ours had to serve: by how much they contradict
        each other (median share of a silhouette, and how many of them do by too much), and how
        much of them the body that all leave covers.
    """
    caster, tracker = RayCaster(mesh.triangles), ContourTracker()
    rows: list[Report] = []
    shares: list[tuple[float, float]] = []
    ours: list[Contours] = []
    without, masked = 0, views.masked()
    for view in views:
        progress(len(rows) + without, len(views))
        unjudged = masked and view.mask is None
        shown, source = (None, "mask") if unjudged else _shown(view, tracker, ours)
        if shown is None or not shown.any():
            without += 1
            continue
        drawn = caster.silhouette(view.camera)
        xor, union = int((drawn ^ shown).sum()), int((drawn | shown).sum())
        over = int((drawn & ~shown).sum())
        shares.append((over / shown.sum(), (xor - over) / shown.sum()))
        outline = outline_length(shown)
        rows.append(
            {
                "stamp_ns": view.stamp_ns,
                "source": source,
                "iou": 1 - xor / union,
                "xor_px": xor,
                "over_px": over,
                "outline_px": outline,
                "xor_per_outline_px": xor / outline,
            }
        )
    report: Report = {"views": rows, "views_without_outline": without}
    if len(ours) > 2:
        agreement = silhouette_agreement(ours)
        report["judges_disagree"] = {
            "median_share": float(np.median(agreement.share)),
            "views": int(agreement.doubtful.sum()),
            "covered": covered_by_hull(ours),
        }
    if rows:
        iou = np.array([row["iou"] for row in rows])
        apart = np.array([row["xor_per_outline_px"] for row in rows])
        report["iou"] = {"mean": float(iou.mean()), "min": float(iou.min())}
        report["xor_per_outline_px"] = {"mean": float(apart.mean()), "max": float(apart.max())}
        report["over_share"], report["missing_share"] = np.mean(shares, axis=0).tolist()
    return report


def outline_length(mask: Mask) -> float:
    """Length of the outline of a mask inside the image, pixels (Crofton's formula, which
    does not count the steps of the pixels)."""
    return float(perimeter_crofton(np.pad(mask, 1, mode="edge"), directions=4))


def _shown(view: View, tracker: ContourTracker, ours: list[Contours]) -> tuple[Mask, str]:
    """Where a view shows the object, and how that is known; contours are added to ours."""
    if view.mask is not None:
        return mask_coverage(view.mask) > 127, "mask"
    try:
        contours = tracker.process(view.image, view.camera, view.stamp_ns, "object", None)
    except ValueError:
        return np.zeros(view.image.shape[:2], bool), "contours"
    ours.append(contours)
    return filled(contours, (view.camera.height, view.camera.width)), "contours"


def filled(contours: Contours, shape: tuple[int, int]) -> Mask:
    """The pixels whose centres lie inside outer loops and outside holes."""
    inside = np.zeros(shape, bool)
    for loop in contours.by_loop(contours.uv):
        inside ^= polygon2mask(shape, loop[:, ::-1])
    return inside


def _belief(report: Report) -> str:
    """How far the judges can be believed that are no masks."""
    words = "judged by outlines that this program found in the images, not by masks of others"
    judges = report.get("judges_disagree")
    if judges is None:
        return f"{words}; too few to say how far they are right"
    if not judges["views"] and judges["covered"] < LEAST_COVERED:
        return (
            f"{words}; the body that all of them leave covers {judges['covered']:.0%} of them: do "
            "not believe these figures, masks of occ-recon segment judge better"
        )
    if not judges["views"]:
        return f"{words}; they agree with each other, which does not prove them right"
    return (
        f"{words}; {judges['views']} of them contradict the others (by "
        f"{judges['median_share']:.1%} in the median): do not believe these figures"
    )


def _described(mesh: trimesh.Trimesh) -> Report:
    return {
        "triangles": len(mesh.faces),
        "watertight": bool(mesh.is_watertight),
        "area_m2": float(mesh.area),
        "volume_m3": float(mesh.volume) if mesh.is_watertight else None,
    }


def evaluation_lines(report: Report) -> list[str]:
    """The result in a few lines for the terminal."""
    rows, iou, apart = report["views"], report["iou"], report["xor_per_outline_px"]
    sources = " and ".join(sorted({row["source"] for row in rows}))
    lines = [
        f"{len(rows)} views against their {sources}: IoU mean {iou['mean']:.4f}, min "
        f"{iou['min']:.4f}; XOR mean {apart['mean']:.2f} px of outline, max {apart['max']:.2f}"
    ]
    if report["cameras"] != "of the bag":
        lines.append(
            "seen by the cameras that the replay corrected (report.json beside the mesh); "
            "--given-cameras takes those of the bag"
        )
    if "contours" in sources:
        lines.append(_belief(report))
    if report["views_without_outline"]:
        lines.append(f"{report['views_without_outline']} views show no outline")
    if (volume := report["surface"]["volume_m3"]) is not None:
        inwards = ", its faces turned inwards" if volume < 0 else ""
        lines.append(f"watertight, volume {1e6 * abs(volume):.3f} cm^3{inwards}")
    else:
        lines.append("the mesh is open: it has no volume, and silhouettes miss what it lacks")
    lines += report["doubts"]
    if "truth" in report:
        truth = report["truth"]
        there, back = truth["mesh_to_truth"], truth["truth_to_mesh"]
        lines += [
            f"accuracy {truth['accuracy_mm']:.4f} mm ({100 * truth['accuracy_share']:.0f} % of the "
            f"mesh is within that of the truth), completeness {100 * truth['completeness']:.2f} % "
            f"(of the truth is within {truth['completeness_within_mm']:g} mm of the mesh)",
            f"mesh to truth: mean {there['mean_mm']:.4f} mm, median {there['p50_mm']:.4f}, 99th "
            f"percentile {there['p99_mm']:.4f}; truth to mesh: mean {back['mean_mm']:.4f} mm, "
            f"median {back['p50_mm']:.4f}, 99th percentile {back['p99_mm']:.4f}",
        ]
    return lines
