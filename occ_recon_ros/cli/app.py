"""The commands and their arguments."""

import signal
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from . import batch, boards
from .ending import exit_code
from .examples import show_examples
from .options import (
    Bag,
    ForBag,
    Json,
    Overwrite,
    Params,
    Quiet,
    Remap,
    Settings,
    Storage,
    Verbose,
    View,
    log_level,
    say,
    scanned,
)

_REFINE = {None: "auto", True: "on", False: "off"}
_INTERRUPTED = 130  # what others make of it

app = typer.Typer(
    name="occ-recon",
    help="Rebuild the surface of an object on a turntable from its occluding contours.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def run(arguments: list[str]) -> int:
    """Run a command line; errors become one line on stderr, with --json an object on stdout
    too, and an exit code."""
    # SIGTERM too shall leave nothing half-written behind.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = _commands()(arguments or ["--help"], "occ-recon", standalone_mode=False)
        if code == _INTERRUPTED:
            raise KeyboardInterrupt
        return code if isinstance(code, int) else 0
    except (Exception, KeyboardInterrupt) as error:
        return exit_code(error, "--json" in arguments)
    finally:
        signal.signal(signal.SIGTERM, before)


@cache
def _commands() -> Any:
    """Made once: reading the types of all arguments takes a tenth of a second."""
    return typer.main.get_command(app)


@app.command("import")
def import_(
    folder: Annotated[
        Path,
        typer.Argument(
            help="images, and cameras.json, a COLMAP model, transforms.json (NeRF), cameras.npz "
            "(IDR, NeuS), *_par.txt (Middlebury), poses_bounds.npy (LLFF) or the cameras.json of "
            "Gaussian splatting"
        ),
    ],
    bag: Bag,
    no_masks: Annotated[bool, typer.Option("--no-masks", help="leave the masks out")] = False,
    storage: Storage = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Images whose cameras are known -> rosbag2."""
    from occ_recon_ros.bags.importing import import_folder
    from occ_recon_ros.bags.reader import open_bag

    from .progress import progress_bar

    with progress_bar("importing", quiet or as_json) as progress:
        found = import_folder(folder, bag, not no_masks, storage, overwrite, progress)
    _show_bag(bag, found[0], as_json, quiet, *found[1:], open_bag(bag).names)


@app.command("record")
def record_(
    bag: Bag,
    remap: Annotated[
        list[str] | None,
        typer.Option(metavar="FROM:=TO", help="record a topic of the rig under one of our names"),
    ] = None,
    storage: Storage = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """What the rig publishes -> rosbag2, until Ctrl-C."""
    from .progress import progress_bar
    from .record import record

    with progress_bar("recording", quiet or as_json) as progress:
        counts = record(bag, remap or [], storage, overwrite, progress)
    _show_bag(bag, counts, as_json, quiet)


@app.command("replay")
def replay_(
    bag: Annotated[Path, typer.Argument(help="folder with metadata.yaml, .mcap or .db3 file")],
    out: Annotated[Path, typer.Option(help="folder for the results, new or empty")],
    rate: Annotated[
        str,
        typer.Option(help="max: as fast as the nodes keep up, no frame lost; 1.0: as recorded"),
    ] = "max",
    clock: Annotated[
        bool, typer.Option("--clock", help="publish the time of the bag; the nodes live by it")
    ] = False,
    remap: Remap = None,
    segment: Annotated[
        str,
        typer.Option(
            help="images without masks: single, one by one; joint, all views together; auto: "
            "together where the outlines of single images contradict each other"
        ),
    ] = "auto",
    refine: Annotated[
        bool | None,
        typer.Option(
            "--refine/--no-refine",
            help="correct poses and calibration by the contours; if nothing is said, where the "
            "outlines disagree by more than they are known to",
        ),
    ] = None,
    params: Params = None,
    settings: Settings = None,
    overwrite: Overwrite = False,
    verbose: Verbose = False,
    view: View = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> int:
    """A recorded sequence through the real topics."""
    from occ_recon_ros.bags.reader import open_bag

    open_bag(bag)  # what is no bag is told of at once, before all else is loaded

    from occ_recon_ros.evaluation.blank import Blank
    from occ_recon_ros.evaluation.image_quality import ImageQuality
    from occ_recon_ros.evaluation.misplaced import Misplaced
    from occ_recon_ros.evaluation.refinement import Refine
    from occ_recon_ros.evaluation.second_look import SecondLook
    from occ_recon_ros.evaluation.segmentation import Segmentation
    from occ_recon_ros.evaluation.shifted import ShiftedPoses

    from .replay import BagSource, Step
    from .scan import ScanOptions

    masks = Segmentation(segment, to_correct=_REFINE[refine] != "off")
    poses = Refine(_REFINE[refine])
    found = masks, poses, SecondLook(masks, poses), Misplaced(masks, poses)
    steps: list[Step] = [Blank(), ShiftedPoses(poses), *found, ImageQuality()]
    source = BagSource(bag, rate, clock, remap or (), steps)
    level = log_level(verbose)
    options = ScanOptions(out, params, settings or (), overwrite, level, view=view)
    return scanned(source, "replaying", options, as_json, quiet)


@app.command("segment")
def segment_(
    source: Annotated[Path, typer.Argument(help="bag with images, camera_info and poses")],
    target: Annotated[Path, typer.Argument(help="bag to write: the same, and /mask")],
    way: Annotated[str, typer.Option(help="auto, joint or single, as for replay")] = "auto",
    remap: Remap = None,
    settings: Settings = None,
    storage: Storage = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Masks that agree over all views.

    Writes the bag again with /mask, and beside it a picture of all masks to look at. Of the
    parameters, contour_tracker.volume_* count, and those of poses.
    """
    from occ_recon_ros.report.words import view_words

    from .arguments import parse_settings
    from .progress import progress_bar
    from .segmenting import segment

    values = parse_settings(settings or ())
    with progress_bar("segmenting", quiet or as_json) as progress:
        report = segment(source, target, way, storage, overwrite, progress, values, remap or ())
    belief = f", belief {report['belief']:.2f} of 1" if "belief" in report else ""
    how = "from those that came" if report["way"] == "given" else f"by {report['way']} views"
    lines = [f"{target}: masks {how}{belief}; look at {report['sheet']}"]
    if "not_used" in report:
        lines.append(f"  masks that came, not used: {report['not_used']}")
    lines += [f"  note: {note}" for note in report.get("notes", ())]
    lines += [f"  images one by one: {reason}" for reason in report.get("single_images", ())]
    lines += [f"  doubtful: {warning}" for warning in report.get("warnings", ())]
    bad = report.get("bad_views", {}).items()
    lines += [f"  {view_words(k, report)}: {why}" for k, why in bad]
    if "agreement" in report:
        lines.append("  agreement: " + " ".join(f"{share:.2f}" for share in report["agreement"]))
    say(report, lines, as_json, quiet)


@app.command("refine")
def refine_(
    source: Annotated[Path, typer.Argument(help="bag with images, camera_info and poses")],
    target: Annotated[
        Path, typer.Argument(help="bag to write: the same, camera_info and camera_pose corrected")
    ],
    remap: Remap = None,
    settings: ForBag = None,
    storage: Storage = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Poses and calibration from the contours.

    They are corrected where that gains on views that were left out.
    """
    from .arguments import parse_settings
    from .progress import progress_bar
    from .refining import refine_bag, refinement_lines

    values = parse_settings(settings or ())
    with progress_bar("refining", quiet or as_json) as progress:
        report = refine_bag(source, target, storage, overwrite, progress, values, remap or ())
    say(report, [f"{target}:", *refinement_lines(report)], as_json, quiet)


@app.command("demo")
def demo_(
    scene_object: Annotated[str, typer.Option("--object", help="what is on the table")] = "vase",
    frames: Annotated[int, typer.Option(help="views in the full turn")] = 36,
    noise: Annotated[
        float, typer.Option(help="random displacement of the outline, 1 sigma in px")
    ] = 0.0,
    out: Annotated[
        Path, typer.Option(help="folder for the results; those of an earlier demo are replaced")
    ] = Path("occ_recon_demo"),
    params: Params = None,
    settings: Settings = None,
    overwrite: Overwrite = False,
    verbose: Verbose = False,
    view: View = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> int:
    """A virtual turntable, judged by the truth."""
    from .demo import TurntableSource
    from .scan import ScanOptions

    source = TurntableSource(scene_object, frames, noise)
    level = log_level(verbose)
    options = ScanOptions(out, params, settings or (), overwrite, level, view=view)
    return scanned(source, "turning", options, as_json, quiet, 0.2 if view else 0.0)


@app.command("run")
def run_(
    params: Params = None,
    settings: Settings = None,
    remap: Annotated[
        list[str] | None,
        typer.Option(metavar="FROM:=TO", help="let a topic of the rig serve as one of ours"),
    ] = None,
    namespace: Annotated[str, typer.Option(help="of the nodes: one a rig")] = "",
    resume: Annotated[
        Path | None,
        typer.Option(
            metavar="STATE", help="go on with the scan whose checkpoints are in this folder"
        ),
    ] = None,
    view: View = False,
    pose: Annotated[
        str,
        typer.Option(
            help="board: run board_pose too (--set board_pose.board=FILE); turntable: "
            "turntable_pose (--set turntable_pose.axis=FILE); topic: camera_pose comes from the "
            "rig; tf: /tf does"
        ),
    ] = "",
    quiet: Annotated[bool, typer.Option("--quiet", help="log warnings only")] = False,
) -> int:
    """All nodes in one process, live."""
    level = "warn" if quiet else "info"
    with suppress(KeyboardInterrupt):
        from .live import run_live

        return run_live(params, settings or [], remap or [], namespace, resume, level, view, pose)
    return 0


@app.command("evaluate")
def evaluate_(
    mesh: Annotated[Path, typer.Argument(help=".ply, .glb, .obj or .stl, metres")],
    bag: Annotated[Path, typer.Option(help="the views, with masks or without")],
    truth: Annotated[Path | None, typer.Option(help="the true surface, a mesh in metres")] = None,
    within: Annotated[float, typer.Option(help="distance of the completeness, mm")] = 1.25,
    out: Annotated[Path | None, typer.Option(help="JSON file for every number")] = None,
    given_cameras: Annotated[
        bool,
        typer.Option("--given-cameras", help="those of the bag, though the replay corrected them"),
    ] = False,
    remap: Remap = None,
    settings: ForBag = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Silhouettes of a mesh, distances to truth.

    The mesh is held against the masks of the bag, or where it has none against the contours of
    its images, as the cameras see them that it was made with.
    """
    from occ_recon_ros.evaluation.silhouettes import evaluate, evaluation_lines

    from .progress import progress_bar
    from .reading import told_views

    views = told_views(bag, remap, settings)
    with progress_bar("evaluating", quiet or as_json) as progress:
        report = evaluate(mesh, views, truth, within, out, overwrite, progress, given_cameras)
    say(report, evaluation_lines(report), as_json, quiet)


@app.command("render")
def render_(
    mesh: Annotated[Path, typer.Argument(help=".ply, .glb, .obj or .stl, metres")],
    bag: Annotated[Path, typer.Option(help="the views")],
    out: Annotated[Path, typer.Option(help="folder for the pictures, new or empty")],
    views: Annotated[
        str, typer.Option(metavar="N,N,...", help="which views of the bag, the first is 0; or all")
    ] = "all",
    remap: Remap = None,
    settings: ForBag = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """A surface drawn over the original images."""
    from occ_recon_ros.report.rendering import render

    from .progress import progress_bar
    from .reading import told_views

    seen = told_views(bag, remap, settings)
    with progress_bar("drawing", quiet) as progress:
        written = render(mesh, seen, out, views, overwrite, progress)
    say({}, [f"{len(written)} pictures in {out}"], False, quiet)


def _show_bag(
    bag: Path,
    counts: Mapping[str, int],
    as_json: bool,
    quiet: bool,
    left_out: Sequence[str] = (),
    remarks: Sequence[str] = (),
    names: Mapping[int, str] | None = None,
) -> None:
    words = ", ".join(f"{topic} {count}" for topic, count in sorted(counts.items()))
    lines = [f"{bag}: {words}", *(f"left out: {why}" for why in left_out), *remarks]
    found: dict[str, Any] = {"bag": str(bag), "messages": dict(counts)}
    found |= {"left_out": list(left_out), "remarks": list(remarks)}
    if names:
        found["images"] = [{"stamp_ns": stamp, "name": name} for stamp, name in names.items()]
    say(found, lines, as_json, quiet)


app.add_typer(boards.calibrate, name="calibrate")
app.command("board")(boards.board)
app.command("scan")(boards.scan)
app.command("batch")(batch.batch_)
show_examples(app)
